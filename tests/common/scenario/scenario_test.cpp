#include "common/scenario/scenario.hpp"

#include <gmock/gmock.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <ostream>
#include <regex>
#include <string>
#include <vector>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/base/errors.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/markov.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

Scenario parse(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return parse_scenario(toml, "test.toml", overrides);
}

/// Error text when `toml` with `overrides` is refused.
std::string refusal(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return refusal_of([&] { parse(toml, overrides); });
}

TEST(Scenario, ATimeoutBelowTheTimeBetweenTwoCommandsIsRefused) {
  const std::string zero = "[actuator]\npolicy = \"zero\"\ntimeout_s = ";
  EXPECT_EQ(refusal(zero + "0.049\n", {"sensor.rate_hz=20"}),
            "test.toml: actuator.timeout_s = 0.049 is below the time between two commands, 0.05 s "
            "(sensor.rate_hz = 20): the vehicle would stop before each of them");
  EXPECT_EQ(refusal(zero + "0.05\n", {"sensor.rate_hz=20"}), "accepted");
  EXPECT_THAT(refusal(zero + "0.9\n", {"controller.trigger=timer", "controller.rate_hz=1"}),
              HasSubstr("(controller.rate_hz = 1)"));
}

std::string text_of(const std::optional<ScenarioValue>& value) {
  if (!value) return "(not set)";
  if (const auto* b = std::get_if<bool>(&*value)) return *b ? "true" : "false";
  if (const auto* i = std::get_if<std::int64_t>(&*value)) return std::to_string(*i);
  if (const auto* s = std::get_if<std::string>(&*value)) return *s;
  if (std::holds_alternative<NumberList>(*value) || std::holds_alternative<NumberRows>(*value)) {
    return testing::PrintToString(*value);
  }
  return "bits " + std::to_string(std::bit_cast<std::uint64_t>(std::get<double>(*value)));
}

/// All keys with their values, bit by bit.
std::vector<std::string> contents(const Scenario& scenario) {
  std::vector<std::string> lines;
  for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
    lines.push_back(key.name + " = " + text_of(key.get(scenario)));
  }
  return lines;
}

/// Allowed values for `key`, likely and unlikely ones, without its default.
std::vector<ScenarioValue> other_values(const ScenarioKey& key) {
  std::vector<ScenarioValue> candidates{true,
                                        false,
                                        0.25,
                                        0.5,
                                        1.5,
                                        5.5,
                                        250e3,
                                        0.05,
                                        std::int64_t{7},
                                        std::int64_t{700},
                                        std::string("AGV7"),
                                        NumberList{0.25, 0.5},
                                        NumberRows{{0.25, 0.75}}};
  const std::regex quoted("\"([^\"]*)\"");
  for (std::sregex_iterator i(key.allowed.begin(), key.allowed.end(), quoted), end; i != end; ++i) {
    candidates.emplace_back((*i)[1].str());
  }
  const Scenario defaults;
  std::vector<ScenarioValue> allowed;
  for (const ScenarioValue& candidate : candidates) {
    Scenario s;
    if (key.set(s, candidate) && key.get(s) != key.get(defaults)) allowed.push_back(candidate);
  }
  return allowed;
}

std::string useless(const Scenario& scenario, const ScenarioKey& key) {
  return ScenarioSchema::all()->why_no_effect(scenario, key.name);
}

/// A choice of one has no other value.
bool is_only_choice(const ScenarioKey& key) {
  return key.allowed.starts_with('"') && key.allowed.find(" or ") == std::string::npos;
}

TEST(Scenario, AnEmptyTextGivesTheDefaults) {
  EXPECT_EQ(contents(parse("")), contents(Scenario{}));
}

TEST(Scenario, EveryKeyCanBeSetAndChangesNothingElse) {
  const Scenario defaults;
  for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
    if (is_only_choice(key)) continue;
    const auto values = other_values(key);
    ASSERT_FALSE(values.empty()) << key.name;
    Scenario changed;
    ASSERT_TRUE(key.set(changed, values.front())) << key.name;
    for (const ScenarioKey& other : ScenarioSchema::all()->keys()) {
      EXPECT_EQ(other.get(changed) != other.get(defaults), other.name == key.name)
          << "set " << key.name << ", look at " << other.name;
    }
  }
}

TEST(Scenario, EveryDefaultIsAnAllowedValue) {
  const Scenario defaults;
  for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
    const auto value = key.get(defaults);
    Scenario s;
    EXPECT_TRUE(!value || key.set(s, *value)) << key.name;
  }
}

TEST(Scenario, OneOfEverythingIsReadFromAFile) {
  Scenario wanted;
  for (const ScenarioKey& key : ScenarioSchema::all()->keys()) {
    // These are given instead of the sojourn times; tests of their own follow.
    if (key.name.ends_with(".p_bad") || key.name.ends_with(".mean_cycle_s")) continue;
    // Both directions become Markov channels, where the fixed state has no effect.
    if (key.name.ends_with("link.prr") || key.name.ends_with("link.delay_ms")) continue;
    // The kinematic plant has no masses and no friction on the floor; tests of its own follow.
    if (key.name == "vehicle.plant") continue;
    if (key.name == "map.file") continue;  // it is read: tests of its own
    // Keys of other paths than the figure eight have no effect on it; tests of their own follow
    // elsewhere.
    if (key.name == "path.kind" ||
        (key.name.starts_with("path.") && !useless(Scenario{}, key).empty()))
      continue;
    // Models and stages of a channel depend on each other; tests of their own follow elsewhere.
    if (key.name.starts_with("channel.") && key.name.find(".markov.") == std::string::npos &&
        !key.name.ends_with(".model") && !key.name.ends_with(".queue_limit")) {
      continue;
    }
    if (key.name.starts_with("medium.radio.") || key.name.starts_with("fleet."))
      continue;  // the same
    // Only those of the chosen policy, law and drivetrain are written.
    if (ScenarioSchema::all()->left_out(wanted, key) &&
        (key.name.starts_with("actuator.") || key.name.starts_with("controller.") ||
         key.name.starts_with("localiser.") || key.name.starts_with("lidar.") ||
         key.name.starts_with("autonomy.") || key.name.starts_with("ros2.")))
      continue;
    if ((key.name.starts_with("vehicle.") || key.name.starts_with("medium.")) &&
        !useless(wanted, key).empty())
      continue;
    // Bounds are of plans, and of this vehicle's errors: tests of their own, tube_test.
    if (key.name.starts_with("tube.")) continue;
    // Age limits depend on rates and time-outs: tests of their own, SendingChanges.
    if (key.name.find(".send") != std::string::npos) continue;
    // The time-outs of the CAN bridge depend on each other; tests of their own follow.
    if (key.name.starts_with("can.") && key.name.ends_with("_ms")) continue;
    if (!is_only_choice(key)) key.set(wanted, other_values(key).front());
  }
  wanted.get<VehicleSettings>().axle_x_m = -0.25;  // behind the chassis' centre: path.point
  wanted.get<ActuatorSettings>().timeout_s = 4.0;  // not below the time between two commands
  EXPECT_EQ(contents(parse(to_toml(wanted))), contents(wanted));
  EXPECT_NE(contents(wanted), contents(Scenario{}));
}

TEST(Scenario, OfTheWaysToStopOnlyTheChosenPolicysAreWritten) {
  for (const std::string policy : {"hold", "zero", "ramp", "decay", "horizon"}) {
    Scenario wanted;
    wanted.get<ActuatorSettings>() = {policy, 0.25, 0.75, 2.5, 3.5, {}};
    const bool ramps = policy == "ramp" || policy == "horizon";
    const auto read = parse(to_toml(wanted)).get<ActuatorSettings>();
    EXPECT_EQ(read.policy, policy);
    EXPECT_EQ(read.timeout_s, 0.25);
    EXPECT_EQ(read.decay_s, policy == "decay" ? 0.75 : 0.5);
    EXPECT_EQ(read.deceleration_mps2, ramps ? 2.5 : 1.5);
    EXPECT_EQ(read.yaw_deceleration_radps2, ramps ? 3.5 : 3.0);
  }
}

TEST(Scenario, TheResolvedTextGivesTheSameScenarioBitByBit) {
  Scenario odd;
  odd.get<RunSettings>().duration_s = 0.1 + 0.2;
  odd.get<RunSettings>().seed = INT64_MAX;
  odd.get<VehicleSettings>().start_x_m = -0.0;
  odd.get<VehicleSettings>().start_yaw_rad = -1.0 / 3.0;
  odd.get<VehicleSettings>().axle_x_m = std::nextafter(-100.0, 0.0);
  odd.get<VehicleSettings>().caster_x_m = std::nextafter(100.0, 0.0);
  odd.get<SensorSettings>().position_noise_m = std::numeric_limits<double>::denorm_min();
  odd.get<SensorSettings>().yaw_noise_rad = std::numeric_limits<double>::min();
  odd.get<WorldSettings>().friction = std::nextafter(1.0, 2.0);
  odd.get<PathSettings>().figure_eight.amplitude_m = 1e4 / 3.0;
  odd.get<ControllerSettings>().tau_s = 999999.99999999988;
  odd.get<ChannelSettings>().uplink.model = "markov";
  odd.get<ChannelSettings>().uplink.own.get<MarkovConfig>().mean_good_s = 1.0 / 7.0;
  EXPECT_EQ(contents(parse(to_toml(odd))), contents(odd));
  EXPECT_EQ(to_toml(parse(to_toml(odd))), to_toml(odd));
}

TEST(Scenario, WholeNumbersServeAsNumbersButNotTheOtherWayRound) {
  EXPECT_EQ(parse("[sensor]\nrate_hz = 5").get<SensorSettings>().rate_hz, 5.0);
  EXPECT_THAT(refusal("[run]\nseed = 5.0"), HasSubstr("a finite whole number >= 0"));
}

TEST(Scenario, TablesMayBeWrittenInAnyOfTomlsWays) {
  EXPECT_EQ(parse("sensor = { rate_hz = 5.0 }").get<SensorSettings>().rate_hz, 5.0);
  EXPECT_EQ(parse("sensor.rate_hz = 5.0").get<SensorSettings>().rate_hz, 5.0);
  EXPECT_EQ(parse("[channel]\nuplink.prr = 0.5").get<ChannelSettings>().uplink.fixed.prr, 0.5);
}

/// A scenario with drives on CAN and these lines under [can].
std::string can_scenario(const std::string& lines) {
  return "vehicle.drivetrain = \"can\"\n[can]\n" + lines;
}

TEST(Scenario, ADrivetrainFileIsLookedForBesideTheScenario) {
  const std::string toml = can_scenario("drivetrain = \"../drivetrains/x.toml\"");
  EXPECT_EQ(parse_scenario(toml, "scenarios/a.toml").get<CanSettings>().drivetrain_file,
            "drivetrains/x.toml");
  EXPECT_EQ(parse_scenario(toml, "scenarios/a.toml", {"can.drivetrain=here/y.toml"})
                .get<CanSettings>()
                .drivetrain_file,
            "here/y.toml");
  EXPECT_EQ(parse_scenario(can_scenario("drivetrain = \"/etc/x.toml\""), "scenarios/a.toml")
                .get<CanSettings>()
                .drivetrain_file,
            "/etc/x.toml");
}

TEST(Scenario, DrivesOnCanNeedADescriptionOfTheirs) {
  EXPECT_THAT(refusal(can_scenario("")), HasSubstr("needs can.drivetrain"));
}

TEST(Scenario, TheTimeOutsOfTheBridgeAreNeverZeroAndInOrder) {
  const std::string file = "drivetrain = \"x.toml\"\n";
  EXPECT_THAT(refusal(can_scenario(file + "stale_ms = 0")), HasSubstr("must be a number in [1,"));
  EXPECT_THAT(refusal(can_scenario(file + "disarm_ms = 0")), HasSubstr("must be a number in [1,"));
  EXPECT_THAT(refusal(can_scenario(file + "stale_ms = 500.0")), HasSubstr("< can.disarm_ms"));
  EXPECT_THAT(refusal(can_scenario(file + "stale_ms = 39.0")), HasSubstr("2 * can.cycle_ms <="));
  EXPECT_EQ(refusal(can_scenario(file + "stale_ms = 40.0\ndisarm_ms = 41.0")), "accepted");
}

TEST(Scenario, StoppingIsNeverWeakerThanAccelerating) {
  const std::string file = "drivetrain = \"x.toml\"\n";
  EXPECT_THAT(refusal(can_scenario(file + "max_deceleration_mps2 = 0.99")),
              HasSubstr("stopping must not be weaker"));
  EXPECT_THAT(refusal(can_scenario(file + "max_yaw_deceleration_radps2 = 1.99")),
              HasSubstr("stopping must not be weaker"));
  EXPECT_EQ(refusal(can_scenario(file + "max_deceleration_mps2 = 1.0")), "accepted");
}

TEST(Scenario, WithoutDrivesOnCanTheResolvedTextNamesNone) {
  EXPECT_THAT(to_toml(parse("[can]\nstale_ms = 100.0")), Not(HasSubstr("[can]")));
}

TEST(Scenario, ThePlantIsOdeOrKinematic) {
  EXPECT_EQ(parse("[vehicle]\nplant = \"kinematic\"").get<VehicleSettings>().plant,
            VehicleSettings::Plant::kinematic);
  EXPECT_THAT(refusal("[vehicle]\nplant = \"bullet\""),
              HasSubstr("must be \"ode\" or \"kinematic\""));
}

TEST(Scenario, AMisspeltKeyIsRefusedWithAGuess) {
  EXPECT_THAT(refusal("[run]\nseed = 1\n\n[sensor]\nrate_hertz = 5.0"),
              AllOf(StartsWith("test.toml:5: "), HasSubstr("unknown key \"sensor.rate_hertz\"")));
  EXPECT_THAT(refusal("[sensor]\nrate_hs = 5.0"), HasSubstr("did you mean \"sensor.rate_hz\"?"));
  EXPECT_THAT(refusal("[chanel.uplink]\nprr = 0.5"),
              HasSubstr("did you mean \"channel.uplink.prr\"?"));
  EXPECT_THAT(refusal("[channel]\nprr = 0.5"), HasSubstr("did you mean \"channel.uplink.prr\"?"));
  EXPECT_THAT(refusal("[vehicle]\nhalf_extent_m = 5.0"),
              HasSubstr("did you mean \"world.half_extent_m\"?"));
  EXPECT_THAT(refusal("rum = 1"), HasSubstr("unknown key \"rum\""));
  EXPECT_THAT(refusal("[sensro]"), HasSubstr("unknown key \"sensro\""));
  EXPECT_THAT(refusal("[[run]]\nseed = 1"), HasSubstr("unknown key \"run\""));
}

struct BadValue {
  const char* section;
  const char* line;
  const char* key;
  const char* allowed;
};

void PrintTo(const BadValue& bad, std::ostream* out) { *out << bad.section << ": " << bad.line; }

struct ScenarioBadValue : testing::TestWithParam<BadValue> {};

TEST_P(ScenarioBadValue, IsRefusedWithFileLineKeyValueAndWhatIsAllowed) {
  const auto& [section, line, key, allowed] = GetParam();
  const std::string text = "# a comment\n[" + std::string(section) + "]\n" + line + "\n";
  const std::string message = refusal(text);
  EXPECT_THAT(message, StartsWith("test.toml:3: " + std::string(key) + " = "));
  EXPECT_THAT(message, HasSubstr(std::string("is not allowed: must be ") + allowed + " ("));
}

constexpr BadValue kBadValues[] = {
    {"sensor", "rate_hz = -1.0", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = 0", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = 1000.0000001", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = nan", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = inf", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = \"20\"", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = true", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = [20.0]", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "rate_hz = 2025-01-01", "sensor.rate_hz", "a number in [0.001, 1000]"},
    {"sensor", "position_noise_m = -1e-9", "sensor.position_noise_m", "a number in [0, 1000000]"},
    {"vehicle", "start_x_m = -inf", "vehicle.start_x_m", "a number in [-10000, 10000]"},
    {"vehicle", "start_x_m = nan", "vehicle.start_x_m", "a number in [-10000, 10000]"},
    {"vehicle", "track_m = 0.0", "vehicle.track_m", "a number in [0.001, 100]"},
    {"vehicle", "name = \"AGV 7\"", "vehicle.name", "letters, digits, '-' and '_', at most 32"},
    {"vehicle", "name = \"\"", "vehicle.name", "letters, digits, '-' and '_', at most 32"},
    {"vehicle", "name = 7", "vehicle.name", "letters, digits, '-' and '_', at most 32"},
    {"run", "seed = -1", "run.seed", "a finite whole number >= 0"},
    {"run", "duration_s = 0.0", "run.duration_s", "a number in [0.001, 1000000]"},
    {"channel", "shared_state = 1", "channel.shared_state", "true or false"},
    {"channel.uplink", "prr = 1.2", "channel.uplink.prr", "a number in [0, 1]"},
    {"channel.uplink", "prr = -0.1", "channel.uplink.prr", "a number in [0, 1]"},
    {"channel.downlink", "prr = nan", "channel.downlink.prr", "a number in [0, 1]"},
    {"channel.downlink", "model = \"Markov\"", "channel.downlink.model",
     "\"fixed\" or \"markov\" or \"gilbert_elliott\" or \"four_state\" or \"chain\" or \"trace\" "
     "or \"map\""},
    {"channel.downlink", "queue_limit = 0", "channel.downlink.queue_limit",
     "a finite whole number >= 1"},
    {"channel.downlink.markov", "mean_bad_s = 0.0", "channel.downlink.markov.mean_bad_s",
     "a number in [0.001, 1000000000]"},
    {"actuator", "policy = \"keep\"", "actuator.policy",
     "\"hold\" or \"zero\" or \"ramp\" or \"decay\" or \"horizon\""},
};

INSTANTIATE_TEST_SUITE_P(Scenario, ScenarioBadValue, testing::ValuesIn(kBadValues));

TEST(Scenario, ASyntaxErrorNamesFileAndLine) {
  EXPECT_THAT(refusal("[run]\nseed = \n"), StartsWith("test.toml:2: "));
  EXPECT_THAT(refusal("[run\n"), StartsWith("test.toml:1: "));
}

TEST(Scenario, ADuplicateKeyIsRefused) {
  EXPECT_THAT(refusal("[run]\nseed = 1\nseed = 2\n"),
              AllOf(StartsWith("test.toml:3: "), HasSubstr("seed")));
  EXPECT_THAT(refusal("[run]\nseed = 1\n[run]\n"), StartsWith("test.toml:3: "));
}

TEST(Scenario, TheVehicleMustStartWithinTheWalls) {
  EXPECT_THAT(refusal("[vehicle]\nstart_x_m = 20.0"),
              AllOf(StartsWith("test.toml: "), HasSubstr("vehicle.start_x_m"),
                    HasSubstr("world.half_extent_m = 22")));
  EXPECT_EQ(refusal("[vehicle]\nstart_x_m = 20.0\n[world]\nhalf_extent_m = 23.0"), "accepted");
}

TEST(Scenario, TheVehicleMustStandWithinTheWallsWhateverItsStartError) {
  EXPECT_EQ(refusal("[vehicle]\nstart_x_m = 18.0\nstart_error_m = 0.5"), "accepted");  // 19.76 m
  EXPECT_THAT(refusal("[vehicle]\nstart_x_m = 18.0\nstart_error_m = 0.6"),
              AllOf(StartsWith("test.toml: "), HasSubstr("vehicle.start_error_m = 0.6"),
                    HasSubstr("world.half_extent_m = 22")));
}

TEST(Scenario, ASharedStateNeedsTheSameModelInBothDirections) {
  const std::string one = "[channel]\nshared_state = true\nuplink.model = \"markov\"\n";
  EXPECT_THAT(refusal(one), HasSubstr("channel.shared_state = true needs the same model"));
  EXPECT_EQ(refusal(one + "downlink.model = \"markov\""), "accepted");
}

}  // namespace
}  // namespace tether
