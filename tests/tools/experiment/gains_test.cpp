#include "tools/experiment/sweep/gains.hpp"

#include <gmock/gmock.h>

#include "controller/laws/controller_settings.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/tools/experiment/file.hpp"

// Experiments that take their laws from a file of tuned gains.

namespace tether {
namespace {

using ::testing::HasSubstr;

Gains two_laws() {
  Gains gains;
  gains.command = "tether tune tune.toml";
  gains.objective = "mean of epsilon_m";
  gains.laws.resize(2);
  TunedLaw &tracking = gains.laws[0], &pid = gains.laws[1];
  tracking.name = "tracking, 20 Hz";
  tracking.settings = {{"controller.law", "'tracking'"}, {"sensor.rate_hz", "20"}};
  tracking.gains = {{"controller.tracking.k_x", "0.123"}};
  tracking.version = "0.1.0+0123456789ab";
  tracking.conditions = {"PRR 1", "PRR \"half\""};
  tracking.seeds = {301, 302, 303};
  tracking.evaluations = 40;
  tracking.found = {0.1, 0.11};
  tracking.before = 0.5;
  tracking.after = 0.1;
  tracking.means_before = {0.25, 1.0};
  tracking.means_after = {0.1, 0.1};
  pid.name = "PID";
  pid.gains = {{"controller.tau_s", "1.31"}};
  pid.version = "0.1.0";
  pid.conditions = {"PRR 1"};
  pid.seeds = {301};
  pid.evaluations = 2;
  pid.found = pid.means_before = pid.means_after = {1.0};
  pid.before = pid.after = 1.0;
  return gains;
}

class TunedGains : public test::ExperimentFile {
 protected:
  TunedGains() { write_file(folder_ / "gains.toml", to_toml(two_laws())); }
};

constexpr char kTuned[] = R"(seeds = { first = 201, last = 210 }
gains = "gains.toml"
[axis.law."best"]
tuned = "tracking, 20 Hz"
[axis.law."other"]
tuned = "PID"
)";

TEST_F(TunedGains, ReadAsTheyWereWritten) {
  Gains expected = two_laws();
  expected.file = (folder_ / "gains.toml").string();
  EXPECT_EQ(read_gains(expected.file), expected);
}

TEST_F(TunedGains, APointTakesTheLawItsRatesAndItsGains) {
  const Experiment e = load(kTuned);
  const auto& best = e.arms[0].scenario;
  EXPECT_EQ(best.get<ControllerSettings>().law, "tracking");
  EXPECT_EQ(best.get<SensorSettings>().rate_hz, 20.0);
  EXPECT_EQ(best.get<ControllerSettings>().tracking.k_x, 0.123);
  EXPECT_EQ(e.arms[1].scenario.get<ControllerSettings>().law, "pid");
  EXPECT_EQ(e.arms[1].scenario.get<ControllerSettings>().tau_s, 1.31);
  EXPECT_EQ(e.arms[0].text(), "law = best") << "the label, not what it takes";
}

TEST_F(TunedGains, SettingsOfAllRunsMayBeTunedToo) {
  const Experiment e = load("seeds = 1\ngains = \"gains.toml\"\n[set]\ntuned = \"PID\"\n");
  EXPECT_EQ(e.arms[0].scenario.get<ControllerSettings>().tau_s, 1.31);
}

TEST_F(TunedGains, WhatAPointSetsItselfBeatsThem) {
  const Experiment e = load(std::string(kTuned) + "controller.tau_s = 4.0\n");
  EXPECT_EQ(e.arms[1].scenario.get<ControllerSettings>().tau_s, 4.0);
}

TEST_F(TunedGains, WhatTheyDoNotHaveIsRefused) {
  const std::string head = "seeds = 1\ngains = \"gains.toml\"\n[axis.law.a]\n";
  EXPECT_THAT(why_refused(head + "tuned = \"LQR\"\n"),
              AllOf(HasSubstr("e.toml:5: tuned = \"LQR\" must be a law of"),
                    HasSubstr("gains.toml: \"tracking, 20 Hz\", \"PID\"")));
  EXPECT_THAT(why_refused("seeds = 1\n[axis.law.a]\ntuned = \"PID\"\n"),
              HasSubstr("e.toml:4: tuned = \"PID\" needs a file of gains"));
  EXPECT_THAT(why_refused("seeds = 1\ngains = \"no.toml\"\n"), HasSubstr("no.toml"));
  EXPECT_THAT(why_refused("seeds = 1\ngains = \"/dev/zero\"\n"), HasSubstr("/dev/zero"));
  EXPECT_THAT(why_refused(head + "tuned = \"PID\"\n[grid]\ncontroller.tau_s = [1, 2]\n"),
              HasSubstr("controller.tau_s is varied twice"));
}

TEST_F(TunedGains, SeedsThatTheyWereTunedWithAreRefused) {
  const std::string gains = "gains = \"gains.toml\"\n";
  EXPECT_THAT(why_refused(gains + "seeds = { first = 290, last = 301 }\n"),
              AllOf(HasSubstr("e.toml: seeds: 301 is one of those that"),
                    HasSubstr("was tuned with (301 to 303)")));
  EXPECT_THAT(why_refused(gains + "[precision]\nmetric = \"epsilon_m\"\nhalf_width = 1.0\n"
                                  "most_seeds = 400\n"),
              HasSubstr("seeds: 301 is one of those"));
  EXPECT_THAT(why_refused(gains + "seeds = [100]\ncommon_random_numbers = false\n"
                                  "[grid]\nchannel.prr = [1, 0.9, 0.8]\n"),
              HasSubstr("seeds: 302 is one of those"));
  EXPECT_EQ(why_refused(gains + "seeds = [300, 304]\n"), "not refused");
}

TEST_F(TunedGains, AFileThatIsNoneIsRefused) {
  const auto why = [this](const std::string& text) {
    write_file(folder_ / "gains.toml", text);
    return why_refused("seeds = 1\ngains = \"gains.toml\"\n");
  };
  EXPECT_THAT(why("seed = 3\n"), HasSubstr("gains.toml:1: unknown key \"seed\""));
  EXPECT_THAT(why("objective = \"small\"\n"), HasSubstr("law must be given"));
  EXPECT_THAT(why("[law.a]\nconditions = [1]\n"), HasSubstr("settings must be given"));
}

}  // namespace
}  // namespace tether
