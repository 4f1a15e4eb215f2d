#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <tether/scan_t.hpp>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/fleet/own_keys.hpp"
#include "common/node/message_io.hpp"
#include "common/path/path_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/loop/lockstep_rig.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
using test::contents;
using test::Folder;
using test::record_of;
using test::run_into;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Three vehicles far from each other, with losses, unless `overrides` say otherwise.
Scenario differing_fleet(const std::vector<std::string>& overrides) {
  std::vector<std::string> all{"vehicle.plant=kinematic", "run.duration_s=10",
                               "fleet.count=3",           "fleet.phases=none",
                               "fleet.offset_x_m=50",     "world.half_extent_m=400",
                               "sensor.rate_hz=10",       "channel.prr=0.8"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return load_scenario(in_source("/scenarios/paper.toml"), all);
}

/// Small, as a localiser's map has to be.
const std::vector<std::string> kSmallHall{"path.kind=circle", "path.radius_m=3",
                                          "fleet.offset_x_m=12", "world.half_extent_m=40"};

std::vector<std::string> in_small_hall(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), kSmallHall.begin(), kSmallHall.end());
  return overrides;
}

std::string fleet_refusal(const std::vector<std::string>& overrides) {
  return refusal_of([&] { differing_fleet(overrides); });
}

const SensorSettings& sensor_of(const std::vector<Scenario>& members, std::size_t i) {
  return members[i].get<SensorSettings>();
}

TEST(FleetDiffer, TablesNameVehiclesByNumbersRangesAndLists) {
  const auto members =
      fleet_members(differing_fleet({"fleet.count=6", "fleet.vehicle.1,3-4,6.sensor.rate_hz=5",
                                     "fleet.vehicle.5.sensor.latency_ms=7"}));
  std::vector<double> rates_hz, latencies_ms;
  for (std::size_t i = 0; i < 6; ++i) {
    rates_hz.push_back(sensor_of(members, i).rate_hz);
    latencies_ms.push_back(sensor_of(members, i).latency_ms);
  }
  EXPECT_THAT(rates_hz, ElementsAre(5, 10, 5, 5, 10, 5));
  EXPECT_THAT(latencies_ms, ElementsAre(0, 0, 0, 0, 7, 0));
}

TEST(FleetDiffer, SeveralTablesOfAVehicleAddUpAndTheCommandLineBeatsTheFile) {
  const Folder folder;
  const fs::path file = folder.path / "fleet.toml";
  std::ofstream(file) << "[fleet]\ncount = 4\noffset_x_m = 40.0\nphases = \"none\"\n"
                         "[world]\nhalf_extent_m = 300.0\n"
                         "[fleet.vehicle.2-3]\nsensor.rate_hz = 5.0\n"
                         "[fleet.vehicle.3.sensor]\nlatency_ms = 20.0\n";
  const auto members =
      fleet_members(load_scenario(file.string(), {"fleet.vehicle.3.sensor.latency_ms=30"}));
  EXPECT_EQ(sensor_of(members, 1).rate_hz, 5.0);
  EXPECT_EQ(sensor_of(members, 2).rate_hz, 5.0);
  EXPECT_EQ(sensor_of(members, 1).latency_ms, 0.0);
  EXPECT_EQ(sensor_of(members, 2).latency_ms, 30.0);
}

TEST(FleetDiffer, AVehicleHasItsOwnLawLossesSensorAndPath) {
  ClosedLoop loop(differing_fleet(
      {"fleet.vehicle.1.controller.law=tracking", "fleet.vehicle.2.channel.uplink.prr=0.2",
       "fleet.vehicle.2.channel.downlink.prr=1", "fleet.vehicle.3.sensor.rate_hz=2",
       "fleet.vehicle.3.path.kind=circle", "fleet.vehicle.3.path.radius_m=6"}));
  EXPECT_EQ(loop.members()[0].get<ControllerSettings>().law, "tracking");
  EXPECT_EQ(loop.members()[1].get<ControllerSettings>().law, "pid");
  std::int64_t undecodable = 0;
  double farthest_m = 0.0;
  subscribe<ground_truth_t>(
      loop.bus(), "SIM3/TRUTH", kDeepQueue, undecodable, [&](const ground_truth_t& truth) {
        const double from_middle_m = std::hypot(truth.x_ref_m - 100.0, truth.y_ref_m - 6.0);
        farthest_m = std::max(farthest_m, std::abs(from_middle_m - 6.0));
      });
  loop.run();
  const auto counters = [&](std::size_t i) { return loop.netem(i).uplink().counters(); };
  EXPECT_EQ(counters(0).offered, counters(1).offered);
  EXPECT_NEAR(static_cast<double>(counters(2).offered), 20.0, 1.0);  // 2 poses a second
  // 100 poses, by their binomial variance within 4 sigma.
  EXPECT_NEAR(static_cast<double>(counters(1).lost), 80.0, 4.0 * 4.0);
  EXPECT_EQ(loop.netem(1).downlink().counters().lost, 0);
  EXPECT_LT(farthest_m, 1e-6);  // the reference is on its own circle
}

TEST(FleetDiffer, TheOthersDriveAsTheyWouldHadItNotDiffered) {
  const std::vector<std::string> own{
      "fleet.vehicle.2.sensor.rate_hz=3", "fleet.vehicle.2.channel.prr=0.3",
      "fleet.vehicle.2.vehicle.max_wheel_speed_mps=2.9", "fleet.vehicle.2.path.amplitude_m=15"};
  std::vector<std::string> of_others[2], of_second;
  for (const bool differs : {false, true}) {
    ClosedLoop loop(differing_fleet(differs ? own : std::vector<std::string>{}));
    loop.bus().subscribe("(SIM|NET|CTRL|AGV)[13]/.*", kDeepQueue, [&](const Message& message) {
      of_others[differs ? 1 : 0].push_back(std::string(message.channel) +
                                           std::string(message.bytes.begin(), message.bytes.end()));
    });
    loop.run();
  }
  EXPECT_GT(of_others[0].size(), 1000U);
  EXPECT_TRUE(of_others[0] == of_others[1]);
}

TEST(FleetDiffer, WhatSaysTheSameAsTheScenarioChangesNoByteOfTheRunOrItsFiles) {
  const Scenario equal = differing_fleet({});
  const Scenario said =
      differing_fleet({"fleet.vehicle.2.sensor.rate_hz=10", "fleet.vehicle.1-3.path.phase=0"});
  EXPECT_EQ(to_toml(said), to_toml(equal));
  EXPECT_TRUE(record_of(said) == record_of(equal));
}

TEST(FleetDiffer, WhatARunWritesReproducesIt) {
  // Each in something that other keys follow from: the start, a preset, gains that only it uses.
  const std::vector<std::string> own{"fleet.vehicle.1.path.kind=line",
                                     "fleet.vehicle.1.path.length_m=9",
                                     "fleet.vehicle.1.path.start_x_m=3",
                                     "fleet.vehicle.1.path.start_yaw_rad=1",
                                     "fleet.vehicle.2.lidar.model=sick_nanoscan3",
                                     "fleet.vehicle.2.lidar.rate_hz=5",
                                     "fleet.vehicle.2-3.channel.model=markov",
                                     "fleet.vehicle.3.controller.law=predictive_consistent",
                                     "fleet.vehicle.3.actuator.policy=horizon",
                                     "run.duration_s=4"};
  const Folder folder;
  const Scenario scenario = differing_fleet(own);
  run_into(folder.path / "a", scenario);
  const Scenario again = load_scenario((folder.path / "a" / "scenario.toml").string(), {});
  run_into(folder.path / "b", again);
  EXPECT_THAT(to_toml(scenario), HasSubstr("\n[fleet.vehicle.1.path]\nkind = \"line\"\n"));
  EXPECT_EQ(contents(folder.path / "a" / "scenario.toml"),
            contents(folder.path / "b" / "scenario.toml"));
  EXPECT_EQ(contents(folder.path / "a" / "run.lcmlog"), contents(folder.path / "b" / "run.lcmlog"));
}

TEST(FleetDiffer, AListThatIsEmptyForAVehicleOnlyStaysEmptyInWhatARunWrites) {
  const Scenario scenario = differing_fleet(
      {"channel.uplink.outages=[[2, 3]]", "fleet.vehicle.2.channel.uplink.outages=[]"});
  const std::string written = to_toml(scenario);
  EXPECT_THAT(written, HasSubstr("\n[fleet.vehicle.2.channel.uplink]\noutages = []\n"));
  EXPECT_TRUE(record_of(parse_scenario(written, "written")) == record_of(scenario));
  EXPECT_FALSE(record_of(scenario) ==
               record_of(differing_fleet({"channel.uplink.outages=[[2, 3]]"})));
}

/// Another value than the scenario has; the same where there is no obvious one.
ScenarioValue another(const ScenarioValue& value) {
  if (const auto* x = std::get_if<bool>(&value)) return !*x;
  if (const auto* x = std::get_if<double>(&value)) return 0.9 * *x + 0.01;
  if (const auto* x = std::get_if<std::int64_t>(&value)) return *x + 1;
  return value;
}

TEST(FleetDiffer, EachKeyThatMayDifferIsWrittenAndReadAsItWasGiven) {
  const Scenario scenario = differing_fleet({});
  int differing = 0;
  for (const ScenarioKey& key : scenario.schema().keys()) {
    const auto value = key.get(scenario);
    if (!value || !may_differ(key.name)) continue;
    const std::string wanted = to_toml(another(*value));
    const std::vector<std::string> own{"fleet.vehicle.2." + key.name + "=" + wanted};
    if (fleet_refusal(own) != "accepted") continue;  // it has no effect here, or needs other keys
    const Scenario given = differing_fleet(own);
    const std::string written = to_toml(given);
    EXPECT_EQ(to_toml(parse_scenario(written, "written")), written) << key.name;
    differing += static_cast<int>(given.get<FleetSettings>().variants.size());
  }
  EXPECT_GT(differing, 40);
}

TEST(FleetDiffer, InLockstepItIsTheSameRun) {
  const Scenario scenario = differing_fleet(in_small_hall(
      {"run.duration_s=4", "sensor.odometry_rate_hz=20", "medium.model=dcf",
       "fleet.vehicle.2.controller.law=tracking", "fleet.vehicle.2.sensor.rate_hz=4",
       "fleet.vehicle.3.lidar.model=sick_nanoscan3", "fleet.vehicle.3.lidar.rate_hz=5",
       "fleet.vehicle.3.localiser.place=vehicle"}));
  test::LockstepRig rig(scenario);
  rig.run();
  EXPECT_TRUE(rig.record == record_of(scenario));
}

TEST(FleetDiffer, OnlyTheVehicleThatHasALocaliserLocalises) {
  ClosedLoop loop(differing_fleet(in_small_hall(
      {"run.duration_s=2", "fleet.vehicle.2.sensor.odometry_rate_hz=50",
       "fleet.vehicle.2.lidar.model=sick_nanoscan3", "fleet.vehicle.2.localiser.place=vehicle"})));
  std::set<std::string> heard;
  loop.bus().subscribe("AGV[0-9]/(SCAN|LOCALISATION|POSE)", kDeepQueue,
                       [&](const Message& message) { heard.emplace(message.channel); });
  loop.run();
  EXPECT_THAT(heard,
              ElementsAre("AGV1/POSE", "AGV2/LOCALISATION", "AGV2/POSE", "AGV2/SCAN", "AGV3/POSE"));
}

TEST(FleetDiffer, ASeedThatASweepGivesIsTheirsToo) {
  Scenario scenario = differing_fleet({"fleet.vehicle.2.channel.prr=0.5"});
  scenario.get<RunSettings>().seed = 77;
  for (const Scenario& member : fleet_members(scenario)) {
    EXPECT_EQ(member.get<RunSettings>().seed, 77U);
  }
}

TEST(FleetDiffer, AVehicleWithAnOpenPathBeginsAtItsStartAndTheOthersWhereTheLapHasThem) {
  const auto members = fleet_members(
      differing_fleet({"fleet.phases=even", "fleet.offset_x_m=0", "fleet.vehicle.2.path.kind=line",
                       "fleet.vehicle.2.path.start_y_m=60", "fleet.vehicle.2.path.length_m=9"}));
  EXPECT_EQ(members[1].get<VehicleSettings>().start_y_m, 60.0);
  EXPECT_EQ(members[2].get<PathSettings>().phase, 2.0 / 3.0);
}

TEST(FleetDiffer, FilesAreLookedForBesideTheScenario) {
  const Folder folder;
  std::ofstream(folder.path / "way.csv") << "x_m,y_m\n0,90\n5,90\n10,90\n";
  const fs::path file = folder.path / "fleet.toml";
  std::ofstream(file) << "[fleet]\ncount = 2\nphases = \"none\"\n[world]\nhalf_extent_m = 100.0\n"
                         "[fleet.vehicle.2.path]\nkind = \"csv\"\ncsv = \"way.csv\"\n";
  const auto members = fleet_members(load_scenario(file.string(), {}));
  EXPECT_EQ(members[1].get<VehicleSettings>().start_y_m, 90.0);
}

TEST(FleetDiffer, RefusesWhatAllShareWhatIsNotThereAndWhatIsSaidTwice) {
  for (const char* shared :
       {"run.seed=4", "run.duration_s=9", "medium.model=dcf", "world.friction=1", "fleet.count=2",
        "can.interface=x", "map.file=x", "vehicle.name=X", "vehicle.plant=ode",
        "vehicle.drivetrain=can", "controller.external=true", "channel.change=[]",
        "channel.links.sat.prr=0.5"}) {
    const std::string key = std::string(shared).substr(0, std::string(shared).find('='));
    EXPECT_THAT(fleet_refusal({std::string("fleet.vehicle.2.") + shared}),
                HasSubstr("--set fleet.vehicle.2." + std::string(shared) + ": fleet.vehicle.2." +
                          key + " is not allowed: " + key +
                          " is all vehicles'; one of a fleet may differ in keys of vehicle"))
        << shared;
  }
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2-4.sensor.rate_hz=5"}),
              HasSubstr("paper.toml: fleet.vehicle.2-4 is not allowed: numbers are 1 to 3, which "
                        "is fleet.count"));
  EXPECT_THAT(fleet_refusal({"fleet.count=1", "fleet.vehicle.1.sensor.rate_hz=5"}),
              HasSubstr("fleet"));
  EXPECT_THAT(
      fleet_refusal({"fleet.vehicle.2-3.sensor.rate_hz=5", "fleet.vehicle.1,3.sensor.rate_hz=5"}),
      HasSubstr("vehicle 3 has sensor.rate_hz twice: fleet.vehicle.1,3.sensor.rate_hz and "
                "fleet.vehicle.2-3.sensor.rate_hz"));
  for (const char* name :
       {"0", "x", "3-2", "2,1", "1,1", "02", "2-", "1001", "1-1001", "-2", "1,"}) {
    EXPECT_THAT(fleet_refusal({std::string("fleet.vehicle.") + name + ".sensor.rate_hz=5"}),
                HasSubstr(std::string("fleet.vehicle.") + name +
                          " is not allowed: must be numbers of vehicles from 1 to 1000"))
        << name;
  }
}

TEST(FleetDiffer, RefusesValuesAsForTheScenario) {
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.sensor.rate_hz=-1"}),
              HasSubstr("fleet.vehicle.2.sensor.rate_hz = -1 is not allowed: must be a number in"));
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.sensor.rate=1"}),
              HasSubstr("did you mean \"fleet.vehicle.2.sensor.rate_hz\"?"));
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.sensor.jump_m=1"}),
              HasSubstr("fleet.vehicle.2: sensor.jump_m has no effect: sensor.jumps_per_min is 0"));
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.controller.law=predictive_consistent"}),
              HasSubstr("AGV2: controller.law is one that sends plans"));
  EXPECT_THAT(fleet_refusal({"medium.model=dcf", "medium.queue=2",
                             "fleet.vehicle.2.actuator.policy=horizon",
                             "fleet.vehicle.2.controller.law=predictive_consistent"}),
              HasSubstr("fleet.vehicle.2: medium.queue = 2 is too short for a command or plan"));
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.vehicle.start_x_m=3"}),
              HasSubstr("fleet.vehicle.2: with fleet.count = 3 each vehicle starts where its path "
                        "begins"));
  EXPECT_THAT(fleet_refusal({"fleet.vehicle.2.vehicle.chassis_length_m=100"}),
              HasSubstr("would start where AGV"));
}

}  // namespace
}  // namespace tether
