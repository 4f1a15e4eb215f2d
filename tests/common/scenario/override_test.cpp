#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/markov.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"

// Behaviour of --set, and of scenario files as files.

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Scenario with(const std::vector<std::string>& overrides, const std::string& toml = "") {
  return parse_scenario(toml, "test.toml", overrides);
}

std::string override_refusal(const std::vector<std::string>& overrides,
                             const std::string& toml = "") {
  return refusal_of([&] { with(overrides, toml); });
}

std::string file_refusal(const std::string& path) {
  return refusal_of([&] { load_scenario(path, {}); });
}

TEST(ScenarioOverride, ReplacesWhatTheFileSaysAndTheLastOneWins) {
  const Scenario s =
      with({"sensor.rate_hz=7", "sensor.rate_hz=9", "run.seed=3"}, "[sensor]\nrate_hz = 5.0");
  EXPECT_EQ(s.get<SensorSettings>().rate_hz, 9.0);
  EXPECT_EQ(s.get<RunSettings>().seed, 3U);
}

TEST(ScenarioOverride, TakesStringsWithOrWithoutQuotes) {
  for (const char* text : {"actuator.policy=zero", "actuator.policy=\"zero\"",
                           "actuator.policy='zero'", "actuator.policy = zero"}) {
    EXPECT_EQ(with({text}).get<ActuatorSettings>().policy, "zero") << text;
  }
}

TEST(ScenarioOverride, TakesNumbersThatTomlWouldNot) {
  EXPECT_EQ(with({"channel.prr=.45"}).get<ChannelSettings>().uplink.fixed.prr, 0.45);
}

TEST(ScenarioOverride, OfTheChannelSetsBothDirections) {
  const Scenario s = with({"channel.prr=0.45", "channel.delay_ms=100"});
  for (const LinkConfig& link :
       {s.get<ChannelSettings>().uplink, s.get<ChannelSettings>().downlink}) {
    EXPECT_EQ(link.fixed.prr, 0.45);
    EXPECT_EQ(link.fixed.delay_ms, 100.0);
  }
}

TEST(ScenarioOverride, OfOneDirectionLeavesTheOtherAlone) {
  const Scenario s = with({"channel.downlink.prr=0.45"});
  EXPECT_EQ(s.get<ChannelSettings>().uplink.fixed.prr, 1.0);
  EXPECT_EQ(s.get<ChannelSettings>().downlink.fixed.prr, 0.45);
}

TEST(ScenarioOverride, OfTheChannelReachesTheMarkovModel) {
  const Scenario s = with({"channel.model=markov", "channel.markov.bad.prr=0.2"});
  for (const LinkConfig& link :
       {s.get<ChannelSettings>().uplink, s.get<ChannelSettings>().downlink}) {
    EXPECT_EQ(link.model, "markov");
    EXPECT_EQ(link.own.get<MarkovConfig>().bad.prr, 0.2);
  }
}

TEST(ScenarioOverride, IsRefusedWithItsOwnTextAndWhatIsAllowed) {
  EXPECT_THAT(override_refusal({"channel.downlink.prr=1.2"}),
              AllOf(StartsWith("--set channel.downlink.prr=1.2: "), HasSubstr("[0, 1]")));
  EXPECT_THAT(override_refusal({"channel.ulpink.prr=0.5"}),
              AllOf(HasSubstr("unknown key"), HasSubstr("channel.uplink.prr")));
  EXPECT_THAT(override_refusal({"sensor.rate_hz=-1"}),
              HasSubstr("must be a number in [0.001, 1000]"));
  EXPECT_THAT(override_refusal({"sensor.rate_hz=nan"}),
              HasSubstr("must be a number in [0.001, 1000]"));
  EXPECT_THAT(override_refusal({"run.duration_s=inf"}),
              HasSubstr("must be a number in [0.001, 1000000]"));
  EXPECT_THAT(override_refusal({"actuator.policy=levitate"}), HasSubstr("\"hold\" or \"zero\""));
}

// Channels and metrics would be another vehicle's.
TEST(ScenarioOverride, RefusesNamesOfVehiclesThatWouldShareChannels) {
  for (const std::string side : {"CTRL", "NET", "SIM", "CAN"}) {
    for (const std::string& name : {side, side + "7", side + "-7", side + "X"}) {
      EXPECT_THAT(override_refusal({"vehicle.name=" + name}),
                  HasSubstr("channels " + side + "... have another meaning"));
    }
  }
  EXPECT_THAT(override_refusal({"vehicle.name=AGV-7"}),
              HasSubstr("channels CTRL-7/... would be those of a vehicle \"7\""));
}

TEST(ScenarioOverride, MustHaveAKeyAndOneReadableValue) {
  EXPECT_THAT(override_refusal({"sensor.rate_hz"}), HasSubstr("expected KEY=VALUE"));
  EXPECT_THAT(override_refusal({"=5"}), HasSubstr("expected KEY=VALUE"));
  EXPECT_THAT(override_refusal({"sensor.rate_hz="}), HasSubstr("cannot read the value"));
  EXPECT_THAT(override_refusal({"sensor.rate_hz=5\nrun.seed = 7"}), HasSubstr("must be one line"));
  EXPECT_THAT(override_refusal({"sensor.rate_hz=[1, 2]"}), HasSubstr("must be a number"));
}

TEST(ScenarioOverride, ThatTheChannelModelIgnoresIsRefused) {
  const std::string markov = "[channel.uplink]\nmodel = \"markov\"";
  EXPECT_THAT(override_refusal({"channel.uplink.prr=0.5"}, markov),
              AllOf(HasSubstr("has no effect"), HasSubstr("model is \"markov\"")));
  EXPECT_THAT(override_refusal({"channel.uplink.markov.bad.prr=0.5"}),
              AllOf(HasSubstr("has no effect"), HasSubstr("model is \"fixed\"")));
  EXPECT_EQ(override_refusal({"channel.downlink.prr=0.5"}, markov), "accepted");
}

TEST(Scenario, AKeyInTheFileThatTheChannelModelIgnoresIsRefused) {
  EXPECT_THAT(
      override_refusal({}, "[channel.uplink]\nmarkov.p_bad = 0.9\nmarkov.mean_cycle_s = 4.0"),
      AllOf(StartsWith("test.toml: channel.uplink.markov."), HasSubstr("has no effect")));
  EXPECT_THAT(override_refusal({}, "[channel.uplink]\nmodel = \"markov\"\nprr = 0.1"),
              AllOf(StartsWith("test.toml: channel.uplink.prr"), HasSubstr("has no effect")));
  // Keys that the file set before an override chose another model are no mistake.
  EXPECT_EQ(override_refusal({"channel.uplink.model=markov"}, "[channel.uplink]\nprr = 0.1"),
            "accepted");
}

TEST(Scenario, ASharedStateNeedsTheSameSojournTimesInBothDirections) {
  const std::vector<std::string> shared{"channel.shared_state=true", "channel.model=markov"};
  auto differing = shared, same = shared;
  differing.push_back("channel.downlink.markov.mean_bad_s=1");
  same.push_back("channel.markov.mean_bad_s=1");
  EXPECT_THAT(override_refusal(differing), HasSubstr("the same sojourn times"));
  EXPECT_EQ(override_refusal(same), "accepted");
}

TEST(ScenarioKeys, ValuesThatWouldOverflowTimeOrPhysicsAreRefused) {
  for (const char* text :
       {"sensor.rate_hz=1e-10", "run.truth_rate_hz=1e-12", "controller.rate_hz=1e-11",
        "actuator.timeout_s=1e10", "controller.pose_timeout_s=1e10", "path.rate_radps=1e308",
        "path.amplitude_m=1e308", "vehicle.chassis_mass_kg=1e308", "vehicle.wheel_mass_kg=1e-300",
        "vehicle.track_m=1e200", "vehicle.caster_x_m=1e300", "vehicle.wheel_radius_m=1e-200",
        "world.gravity_mps2=1e308"}) {
    EXPECT_THAT(override_refusal({text}), ContainsRegex("must be (0 or )?a number in ")) << text;
  }
}

// For these keys 0 means never, off or at once.
TEST(ScenarioKeys, ATimeOrARateThatRoundsToZeroIsRefused) {
  for (const char* key :
       {"controller.pose_timeout_s", "can.operator_timeout_ms", "sensor.odometry_rate_hz",
        "run.lead_s", "channel.uplink.delay_ms", "sensor.latency_ms"}) {
    EXPECT_THAT(override_refusal({std::string(key) + "=1e-300"}),
                AllOf(HasSubstr(key), HasSubstr("must be 0 or a number in [")));
    EXPECT_THAT(override_refusal({std::string(key) + "=0"}), Not(HasSubstr("must be")));
  }
  EXPECT_THAT(override_refusal({"run.duration_s=1e-300"}),
              HasSubstr("must be a number in [0.001, 1000000]"));
  EXPECT_EQ(override_refusal({"controller.pose_timeout_s=1e-9"}), "accepted");
}

TEST(ScenarioFile, ThatCannotBeReadIsRefusedByName) {
  EXPECT_THAT(file_refusal("/no/such/file.toml"), HasSubstr("\"/no/such/file.toml\""));
  EXPECT_THAT(file_refusal("/"), HasSubstr("cannot read the scenario file \"/\""));
}

TEST(ScenarioFile, MayBeEmpty) {
  const test::Folder folder;
  EXPECT_EQ(to_toml(load_scenario(folder.file("empty.toml", "").string(), {})),
            to_toml(Scenario{}));
}

TEST(ScenarioFile, IsNamedWithItsPathInMessages) {
  const test::Folder folder;
  const std::string file =
      folder.file("odd.toml", "[run]\nseed = 1\n[sensor]\nrate_hz = \"often\"\n").string();
  EXPECT_THAT(file_refusal(file),
              AllOf(StartsWith(file + ":4: sensor.rate_hz"), HasSubstr("often")));
}

TEST(ScenarioFile, ResolvesToItselfWithEveryLawBehindTheFilter) {
  for (const LawKind& law : law_kinds()) {
    std::vector<std::string> overrides{"controller.law=" + law.name, "controller.estimator=ekf",
                                       "controller.sensor_latency_ms=50"};
    if (law.sends_plans) {
      overrides.insert(overrides.end(), {"actuator.policy=horizon", "controller.adapt.lag=true"});
    }
    if (law.drives_on_request) {
      overrides.insert(overrides.end(), {"autonomy.enabled=true", "lidar.model=custom",
                                         "sensor.odometry_rate_hz=50"});
    }
    const std::string text = to_toml(load_scenario(in_source("/scenarios/paper.toml"), overrides));
    EXPECT_EQ(to_toml(parse_scenario(text, in_source("/scenarios/again.toml"))), text) << law.name;
  }
}

TEST(ScenarioFile, TheShippedOnesLoadAndRoundTrip) {
  for (const char* name : {"paper.toml", "paper_markov.toml", "paper_slow.toml"}) {
    const Scenario s = load_scenario(in_source("/scenarios/") + name, {});
    EXPECT_EQ(s.get<RunSettings>().duration_s, 62.0);
    EXPECT_EQ(s.get<SensorSettings>().rate_hz, 1.0);
    EXPECT_EQ(s.get<VehicleSettings>().track_m, 1.2);
    EXPECT_EQ(s.get<ActuatorSettings>().policy, "hold");
    EXPECT_EQ(to_toml(parse_scenario(to_toml(s), "again")), to_toml(s));
  }
}

TEST(ScenarioFile, ThePapersSlowVehicleDiffersInWhatItsDocumentationSaysOnly) {
  const std::string folder = in_source("/scenarios/");
  EXPECT_EQ(
      to_toml(load_scenario(folder + "paper_slow.toml", {})),
      to_toml(load_scenario(folder + "paper.toml", {"controller.v.limit=2.8", "controller.v.p=0.48",
                                                    "controller.v.d=0"})));
}

TEST(ScenarioFile, ThePapersMarkovChannelHasItsProbabilitiesAndSojournTimes) {
  const Scenario s = load_scenario(in_source("/scenarios/paper_markov.toml"), {});
  EXPECT_TRUE(s.get<ChannelSettings>().shared_state);
  for (const LinkConfig& link :
       {s.get<ChannelSettings>().uplink, s.get<ChannelSettings>().downlink}) {
    EXPECT_DOUBLE_EQ(
        link.own.get<MarkovConfig>().mean_bad_s /
            (link.own.get<MarkovConfig>().mean_bad_s + link.own.get<MarkovConfig>().mean_good_s),
        0.25);
    EXPECT_DOUBLE_EQ(link.own.get<MarkovConfig>().mean_bad_s, 8.0);
    EXPECT_EQ(link.own.get<MarkovConfig>().bad.prr, 0.5);
    EXPECT_EQ(link.own.get<MarkovConfig>().bad.delay_ms, 500.0);
  }
}

TEST(ScenarioKeys, TheTableForPeopleNamesEveryKeyWithDefaultMeaningAndRange) {
  const std::string table = describe_scenario_keys();
  for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
    EXPECT_THAT(table, HasSubstr(key.name + " = "));
    EXPECT_THAT(table, HasSubstr(key.meaning + "; " + key.allowed));
  }
}

}  // namespace
}  // namespace tether
