#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "common/fleet/fleet.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/chain.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/experiment/file.hpp"

// Axes with names and labels, parts, and what an experiment file wants to see; and the project's
// own files of control over a bad network.

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

using test::texts;

/// With one seed.
class ExperimentAxes : public test::ExperimentFile {
 protected:
  Experiment load(const std::string& text, const std::vector<std::string>& overrides = {}) {
    return ExperimentFile::load("seeds = 1\n" + text, overrides);
  }
  std::string why_refused(const std::string& text, const std::vector<std::string>& overrides = {}) {
    return ExperimentFile::why_refused("seeds = 1\n" + text, overrides);
  }
};

constexpr char kLaws[] = R"(
[axis.law."PID"]
[axis.law."a tracking law"]
controller.law = "tracking"
sensor.rate_hz = 20.0
)";

TEST_F(ExperimentAxes, ANamedAxisGoesByItsLabelsAndSetsWhatEachSays) {
  const Experiment e = load(std::string(kLaws) + "[grid]\nchannel.prr = [1, 0.5]\n");
  EXPECT_THAT(e.keys, ElementsAre("law", "channel.prr"));
  EXPECT_THAT(texts(e), ElementsAre("law = PID, channel.prr = 1", "law = PID, channel.prr = 0.5",
                                    "law = a tracking law, channel.prr = 1",
                                    "law = a tracking law, channel.prr = 0.5"));
  EXPECT_EQ(e.arms[0].scenario.get<ControllerSettings>().law, "pid");
  EXPECT_EQ(e.arms[0].scenario.get<SensorSettings>().rate_hz, 1.0) << "the scenario's own";
  EXPECT_EQ(e.arms[3].scenario.get<ControllerSettings>().law, "tracking");
  EXPECT_EQ(e.arms[3].scenario.get<SensorSettings>().rate_hz, 20.0);
  EXPECT_EQ(e.arms[3].scenario.get<ChannelSettings>().uplink.fixed.prr, 0.5);
}

TEST_F(ExperimentAxes, AreOfSomeVehiclesOfAFleet) {
  const std::string fleet = "[set]\nfleet.count = 3\n";
  const Experiment e = load(fleet + "[grid]\nfleet.vehicle.\"2-3\".channel.prr = [1, 0.5]\n");
  EXPECT_THAT(e.keys, ElementsAre("fleet.vehicle.2-3.channel.prr"));
  const auto prr = [&](std::size_t arm, std::size_t vehicle) {
    return fleet_members(e.arms[arm].scenario)[vehicle].get<ChannelSettings>().uplink.fixed.prr;
  };
  EXPECT_EQ(prr(1, 0), 1.0);
  EXPECT_EQ(prr(0, 1), 1.0);
  EXPECT_EQ(prr(1, 1), 0.5);
  EXPECT_EQ(prr(1, 2), 0.5);
  EXPECT_THAT(why_refused(fleet + "[grid]\nfleet.vehicle.2.world.friction = [1, 0.5]\n"),
              HasSubstr("fleet.vehicle.2.world.friction is not allowed: world.friction is all"));
  EXPECT_THAT(why_refused(fleet + "[grid]\nfleet.vehicle.2.channel.prr = [1, 0.5]\n",
                          {"fleet.vehicle.2.channel.uplink.prr=0.3"}),
              HasSubstr("fleet.vehicle.2.channel.uplink.prr is varied by the grid"));
}

TEST_F(ExperimentAxes, LabelsKeepTheOrderOfTheFile) {
  const Experiment e = load("[axis.PRR]\n\"1\" = {}\n\"0.5\" = {}\n\"0.75\" = {}\n");
  EXPECT_THAT(texts(e), ElementsAre("PRR = 1", "PRR = 0.5", "PRR = 0.75"));
}

TEST_F(ExperimentAxes, APointMayChangeWhatIsSetForAll) {
  const Experiment e = load("[set]\nsensor.rate_hz = 5.0\n" + std::string(kLaws));
  EXPECT_EQ(e.arms[0].scenario.get<SensorSettings>().rate_hz, 5.0);
  EXPECT_EQ(e.arms[1].scenario.get<SensorSettings>().rate_hz, 20.0);
}

constexpr char kParts[] = R"(
[[part]]
[part.axis.error]
"none" = {}
[part.axis.size]
"0" = {}
[[part]]
[part.set]
controller.tau_s = 3.0
[part.axis.error]
"radius" = {}
[part.axis.size]
"1" = { vehicle.radius_error = 0.01 }
"2" = { vehicle.radius_error = 0.02 }
)";

TEST_F(ExperimentAxes, PartsAreCrossesOfTheirOwnOneAfterTheOther) {
  const Experiment e = load(std::string(kLaws) + kParts);
  EXPECT_THAT(e.keys, ElementsAre("law", "error", "size"));
  EXPECT_THAT(texts(e), ElementsAre("law = PID, error = none, size = 0",
                                    "law = a tracking law, error = none, size = 0",
                                    "law = PID, error = radius, size = 1",
                                    "law = PID, error = radius, size = 2",
                                    "law = a tracking law, error = radius, size = 1",
                                    "law = a tracking law, error = radius, size = 2"));
  EXPECT_EQ(e.arms[0].scenario.get<ControllerSettings>().tau_s, 2.0);
  EXPECT_EQ(e.arms[3].scenario.get<ControllerSettings>().tau_s, 3.0);
  EXPECT_EQ(e.arms[3].scenario.get<VehicleSettings>().radius_error, 0.02);
}

TEST_F(ExperimentAxes, APartsAxisTakesThePlaceOfTheCommonOne) {
  const Experiment e = load(std::string(kLaws) +
                            "[[part]]\n[part.axis.PRR]\n\"1\" = {}\n"
                            "[[part]]\n[part.axis.law]\n\"third\" = {}\n[part.axis.PRR]\n1 = {}\n");
  EXPECT_THAT(texts(e), ElementsAre("law = PID, PRR = 1", "law = a tracking law, PRR = 1",
                                    "law = third, PRR = 1"));
}

TEST_F(ExperimentAxes, WhatIsWrongIsRefusedWithItsPlace) {
  EXPECT_THAT(why_refused("[axis]\nlaw = 3\n"), HasSubstr("e.toml:4: write [axis.NAME"));
  EXPECT_THAT(why_refused("[axis.\"a b\".c]\n"), HasSubstr("letters, digits"));
  EXPECT_THAT(why_refused("[axis.law]\na = 1\n"), HasSubstr("e.toml:4: axis.law.\"a\" must be"));
  EXPECT_THAT(why_refused("[axis.law.a]\ncontroller.lav = \"pid\"\n"),
              HasSubstr("e.toml:4: unknown key \"controller.lav\""));
  EXPECT_THAT(why_refused("[axis.law.a]\nrun.seed = 1\n"), HasSubstr("use seeds"));
  EXPECT_THAT(why_refused("[axis.a.x]\nchannel.prr = 1\n[axis.b.x]\nchannel.uplink.prr = 1\n"),
              HasSubstr("channel.uplink.prr is varied twice (by channel.prr and"));
  EXPECT_THAT(why_refused("part = []\n"), HasSubstr("write [[part]]"));
  EXPECT_THAT(why_refused("[[part]]\nseeds = 3\n"), HasSubstr("unknown key \"part.seeds\""));
  EXPECT_THAT(why_refused("[[part]]\n[part.axis.a.x]\n[[part]]\n[part.axis.b.x]\n"),
              HasSubstr("varies b, but the first part varies a"));
  EXPECT_THAT(why_refused("[[part]]\n[part.axis.a.x]\n[[part]]\n[part.axis.a.x]\n"),
              HasSubstr("two parts have the combination a = x"));
  EXPECT_THAT(why_refused(kLaws, {"sensor.rate_hz=3"}), HasSubstr("is varied by the grid"));
}

TEST_F(ExperimentAxes, AFigureMayShowSomeArmsOnly) {
  const std::string text = std::string(kLaws) + kParts;
  const std::string figure = "[figure]\nkind = \"comparison\"\nx = \"size\"\ny = \"law\"\n";
  EXPECT_EQ(load(text + figure).figure->kind, FigureChoice::Kind::comparison);
  const Experiment e = load(text + figure + "where = { error = \"radius\", size = [\"1\", 2] }\n");
  std::size_t selected = 0;
  for (const Arm& arm : e.arms) selected += is_selected(e.figure->where, arm.settings) ? 1 : 0;
  EXPECT_EQ(selected, 4U);
  EXPECT_THAT(why_refused(text + figure + "where = { error = \"no such\" }\n"),
              HasSubstr("where selects no combination"));
  EXPECT_THAT(why_refused(text + figure + "where = { eror = \"none\" }\n"),
              HasSubstr("a key that the grid varies: law, error, size"));
  EXPECT_THAT(why_refused(text + figure + "floor = \"no such\"\n"), HasSubstr("a value of law"));
  EXPECT_THAT(why_refused(text + "[figure]\nx = \"size\"\nfloor = \"PID\"\n"),
              HasSubstr("only comparisons have it"));
  const std::string pareto = "[figure]\nkind = \"pareto\"\ny = \"law\"\n";
  const auto figure_of_medium = load(text + pareto + "x = \"medium_busy\"\n").figure;
  EXPECT_EQ(figure_of_medium->kind, FigureChoice::Kind::pareto) << "several arms at each law";
  for (const char* x : {"", "x = \"epsilon_m\"\n"}) {
    EXPECT_THAT(why_refused(text + pareto + x), HasSubstr("a metric other than that of y")) << x;
  }
  EXPECT_THAT(why_refused(text + pareto + "x = \"size\"\n"), HasSubstr("medium_busy"));
}

TEST_F(ExperimentAxes, TablesThatCannotBeMadeAreRefused) {
  const std::string text = std::string(kLaws) + kParts + "[[table]]\n";
  EXPECT_THAT(load(text + "columns = [\"size\"]\n").tables, SizeIs(1));
  EXPECT_THAT(why_refused(text), HasSubstr("columns must be a list of keys"));
  EXPECT_THAT(why_refused(text + "columns = [\"seize\"]\n"), HasSubstr("law, error, size"));
  EXPECT_THAT(why_refused(text + "kind = \"ratio\"\nkey = \"law\"\nlimit = 10\nover = \"PID\"\n"),
              HasSubstr("two values of law"));
  EXPECT_THAT(why_refused(text + "kind = \"ratio\"\nkey = \"law\"\nlimit = 10\nover = \"PID\"\n"
                                 "under = \"LQR\"\n"),
              HasSubstr("law is never \"LQR\""));
  EXPECT_THAT(why_refused(text + "kind = \"limit\"\nkey = \"size\"\n"),
              HasSubstr("limit must be given"));
  EXPECT_THAT(why_refused(text + "kind = \"limit\"\nkey = \"error\"\nlimit = 1\n"),
              HasSubstr("error = none is no number"));
}

// ------------------------------------------------------------- the project's experiments

Experiment of_the_project(const std::string& name, bool quick = false) {
  return load_experiment(in_source("/experiments/") + name + ".toml", {}, quick);
}

std::size_t count(const Experiment& e, const Selection& selection) {
  return static_cast<std::size_t>(std::count_if(e.arms.begin(), e.arms.end(), [&](const Arm& arm) {
    return is_selected(selection, arm.settings);
  }));
}

TEST(ProjectExperiments, AllLoad) {
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(in_source("/experiments"))) {
    if (entry.is_directory()) continue;
    EXPECT_NO_THROW(load_experiment(entry.path().string())) << entry.path();
    ++files;
  }
  EXPECT_GE(files, 13U);
}

TEST(ProjectExperiments, TheBenchmarkHasThirteenLawsInFifteenChannelsAndFourNullControls) {
  const Experiment e = of_the_project("control_benchmark");
  EXPECT_THAT(e.keys, ElementsAre("law", "PRR", "delay_ms", "burst"));
  EXPECT_THAT(e.arms, SizeIs(13 * 15 + 2 * 4 + 4));
  EXPECT_EQ(count(e, {{"delay_ms", {"100", "250", "500"}}}), 13U * 6);
  EXPECT_EQ(count(e, {{"burst", {"5", "20"}}}), 13U * 2);
  EXPECT_EQ(count(e, {{"law", {"PID, 20/20 Hz, for PRR 0.45"}}}), 4U);
  EXPECT_THAT(e.seeds, SizeIs(30));
  EXPECT_TRUE(e.common_random_numbers);
  EXPECT_THAT(of_the_project("control_benchmark", true).seeds, SizeIs(4));
  for (const Arm& arm : e.arms) {
    EXPECT_EQ(arm.scenario.get<VehicleSettings>().max_wheel_acceleration_mps2, 3.0) << arm.text();
    EXPECT_EQ(arm.scenario.get<SensorSettings>().position_noise_m, 0.02) << arm.text();
  }
}

TEST(ProjectExperiments, RobustnessHasBothLawsUnderEachErrorAtEachPrrAndThreeNullControls) {
  const Experiment e = of_the_project("control_robustness");
  EXPECT_THAT(e.arms, SizeIs(2 * (11 * 5 + 2 * 4) + 3 * 11));
  EXPECT_EQ(count(e, {{"law", {"PID, 20/20 Hz"}}, {"error", {"none"}}}), 5U);
  EXPECT_EQ(count(e, {{"error", {"bursts of 20 packets"}}}), 8U);
}

constexpr const char* kOfControl[] = {"control_benchmark", "control_rates",   "control_robustness",
                                      "control_breaking",  "control_targets", "control_markov",
                                      "control_frames",    "control_mpc"};

TEST(ProjectExperiments, EachOfControlStartsInexactlyAndHasTheNullControls) {
  for (const char* name : kOfControl) {
    const Experiment e = of_the_project(name);
    const std::string key = count(e, {{"law", {"PID, 20/20 Hz"}}}) > 0 ? "law" : "case";
    for (const char* null :
         {"plan on board, no packet", "on board, tracking 20 Hz", "on board, PID 20 Hz"}) {
      EXPECT_GE(count(e, {{key, {null}}}), 1U) << name << ": " << null;
    }
    for (const Arm& arm : e.arms) {
      EXPECT_EQ(arm.scenario.get<VehicleSettings>().start_error_m, 0.1) << name << arm.text();
      EXPECT_EQ(arm.scenario.get<VehicleSettings>().start_error_rad, 0.05) << name << arm.text();
    }
  }
}

TEST(ProjectExperiments, NoPacketMeansNone) {
  for (const char* name : kOfControl) {
    for (const Arm& arm : of_the_project(name).arms) {
      if (!arm.text().starts_with("law = plan on board") &&
          arm.text().find("case = plan on board") == std::string::npos) {
        continue;
      }
      const auto& channel = arm.scenario.get<ChannelSettings>();
      for (const LinkConfig& link : {channel.uplink, channel.downlink}) {
        EXPECT_EQ(link.model, "fixed") << name << arm.text();
        EXPECT_EQ(link.fixed.prr, 0.0) << name << arm.text();
      }
    }
  }
}

/// PRR and mean burst that a chain of two states has in the long run.
std::pair<double, double> long_run(const LinkConfig& link) {
  const auto& p = link.own.get<ChainConfig>().probabilities;
  const double to_bad = p[0][1], to_good = p[1][0];
  return {to_good / (to_bad + to_good), 1.0 / to_good};
}

TEST(ProjectExperiments, BurstsHaveThePrrAndTheLengthOfTheirLabels) {
  for (const char* name : {"control_benchmark", "control_robustness", "control_breaking"}) {
    std::size_t chains = 0;
    for (const Arm& arm : of_the_project(name).arms) {
      if (arm.scenario.get<ChannelSettings>().uplink.model != "chain") continue;
      ++chains;
      double prr = 0.45, burst = 0.0;  // arms of control_breaking, which has no PRR
      for (const KeyValue& setting : arm.settings) {
        const std::string value = setting.plain();
        if (setting.key == "PRR") prr = std::stod(value);
        if (setting.key == "burst" || setting.key == "size") burst = std::stod(value);
        if (value.starts_with("bursts of ")) burst = std::stod(value.substr(10));
      }
      for (const LinkConfig& link : {arm.scenario.get<ChannelSettings>().uplink,
                                     arm.scenario.get<ChannelSettings>().downlink}) {
        EXPECT_NEAR(long_run(link).first, prr, 1e-4) << arm.text();
        EXPECT_NEAR(long_run(link).second / burst, 1.0, 1e-4) << arm.text();
      }
    }
    EXPECT_GE(chains, 6U) << name;
  }
}

}  // namespace
}  // namespace tether
