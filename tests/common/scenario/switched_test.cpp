#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "common/scenario/section.hpp"
#include "tests/support/refusal.hpp"

// Keys that say more of something which is off.

namespace tether {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string switch_refusal(const std::vector<std::string>& overrides,
                           const std::string& toml = "") {
  return refusal_of([&] { parse_scenario(toml, "test.toml", overrides); });
}

TEST(SwitchedKeys, AreRefusedWhereNothingTurnsThemOn) {
  const std::vector<std::pair<std::string, std::string>> keys{
      {"sensor.jump_m=0.2", "sensor.jump_m has no effect: sensor.jumps_per_min is 0"},
      {"sensor.jump_rad=0.2", "sensor.jumps_per_min is 0"},
      {"sensor.jump_s=1", "sensor.jumps_per_min is 0"},
      {"sensor.dropout_s=2", "sensor.dropouts_per_min is 0"},
      {"sensor.noise_correlation_s=2", "sensor.position_noise_m and sensor.yaw_noise_rad are 0"},
      {"world.bump_height_m=0.03", "world.bump_spacing_m is 0"},
      {"world.bump_length_m=0.3", "world.bump_spacing_m is 0"},
      {"vehicle.payload_y_m=0.1", "vehicle.payload_kg is 0"},
      {"controller.rate_hz=5", "controller.trigger is \"event\""},
      {"can.inject_at_s=5", "can.inject is \"none\""}};
  for (const auto& [key, why] : keys) {
    EXPECT_THAT(switch_refusal({key}), HasSubstr("--set: " + key.substr(0, key.find('=')))) << key;
    EXPECT_THAT(switch_refusal({key}), HasSubstr("has no effect: ")) << key;
    EXPECT_THAT(switch_refusal({key}), HasSubstr(why)) << key;
  }
  EXPECT_THAT(switch_refusal({}, "[sensor]\njump_m = 0.2"),
              HasSubstr("test.toml: sensor.jump_m has no effect"));
}

TEST(SwitchedKeys, AreAcceptedWithTheSwitchAtAnyLevelAndWhereItIsSaidThatItIsOff) {
  EXPECT_EQ(switch_refusal({"sensor.jump_m=0.2", "sensor.jumps_per_min=6"}), "accepted");
  EXPECT_EQ(switch_refusal({"sensor.jump_m=0.2"}, "[sensor]\njumps_per_min = 6"), "accepted");
  EXPECT_EQ(switch_refusal({"sensor.jumps_per_min=0"}, "[sensor]\njumps_per_min = 6\njump_m = 0.2"),
            "accepted");
  EXPECT_EQ(switch_refusal({"sensor.jump_m=0.2", "sensor.jumps_per_min=0"}), "accepted")
      << "as in a sweep over it";
  EXPECT_EQ(switch_refusal({"sensor.noise_correlation_s=2", "sensor.yaw_noise_rad=0.1"}),
            "accepted");
  EXPECT_THAT(switch_refusal({"sensor.jump_m=0.2"}, "[sensor]\njumps_per_min = 0"),
              HasSubstr("sensor.jumps_per_min is 0"));
}

TEST(SwitchedKeys, AreInTheResolvedScenarioOnlyWhereTheyAreOn) {
  const auto resolved = [](const std::vector<std::string>& overrides) {
    return to_toml(parse_scenario("", "test.toml", overrides));
  };
  EXPECT_THAT(resolved({"sensor.jump_m=0.2", "sensor.jumps_per_min=0"}), Not(HasSubstr("jump_m")));
  EXPECT_THAT(resolved({"sensor.jump_m=0.2", "sensor.jumps_per_min=6"}),
              HasSubstr("jump_m = 0.2\n"));
  EXPECT_THAT(resolved({}), Not(HasSubstr("payload_x_m")));
  EXPECT_THAT(resolved({"vehicle.payload_kg=1"}), HasSubstr("payload_x_m = 0.0\n"));
}

TEST(SwitchedKeys, AndTheirSwitchesAreKeysOfOneSection) {
  for (const ScenarioSection& section : ScenarioSchema::all()->sections()) {
    const auto has = [&section](const std::string& name) {
      return std::any_of(section.keys.begin(), section.keys.end(),
                         [&name](const ScenarioKey& key) { return key.name == name; });
    };
    for (const SwitchedKey& switched : section.switched) {
      EXPECT_TRUE(has(switched.key)) << switched.key;
      EXPECT_FALSE(switched.switches.empty()) << switched.key;
      for (const std::string& name : switched.switches) EXPECT_TRUE(has(name)) << name;
    }
  }
}

TEST(SwitchedKeys, OfLawsPoliciesAndDrivesMayStandWhereOthersAreChosen) {
  for (const char* key :
       {"controller.sensor_latency_ms=50", "controller.tracking.k_x=1", "actuator.decay_s=1",
        "can.bit_rate_bps=250000", "sensor.odometry_rate_hz=20"}) {
    EXPECT_EQ(switch_refusal({key}), "accepted") << key;
  }
}

TEST(KeysOfMaps, AreRefusedWhereOthersReplaceThem) {
  const auto map = [](const std::string& key, const std::string& other = "map.delay_ms=0") {
    const std::string uplink = "channel.uplink.";
    return switch_refusal({uplink + "model=map", uplink + "map.access_points=[[0, 0]]",
                           uplink + key, uplink + other});
  };
  EXPECT_THAT(map("map.shadowing_distance_m=5"),
              HasSubstr("channel.uplink.map.shadowing_distance_m has no effect: "
                        "channel.uplink.map.shadowing_sd_db is 0"));
  EXPECT_EQ(map("map.shadowing_distance_m=5", "map.shadowing_sd_db=3"), "accepted");
  EXPECT_THAT(map("map.slope_db=2", "map.prr_curve=[[0, 0], [20, 1]]"),
              HasSubstr("channel.uplink.map.prr_curve is given"));
  EXPECT_THAT(map("map.delay_ms=2", "map.delay_curve=[[0, 9], [20, 1]]"),
              HasSubstr("channel.uplink.map.delay_curve is given"));
}

TEST(RefusedNumbers, AreTheShortestThatReadTheSame) {
  EXPECT_THAT(switch_refusal({"vehicle.start_error_m=-0.1"}),
              HasSubstr("vehicle.start_error_m = -0.1 is not allowed"));
  EXPECT_THAT(switch_refusal({"run.duration_s=[0.1, 2.0]"}),
              HasSubstr("= [0.1, 2.0] is not allowed"));
}

// ---------------------------------------------------------------------------- send = "changed"

TEST(SendingChanges, NeedsAnAgeLimitBelowTheReceiversTimeouts) {
  const std::vector<std::string> poses{"sensor.send=changed", "sensor.rate_hz=20"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), poses.begin(), poses.end());
    return switch_refusal(more);
  };
  EXPECT_EQ(with({}), "accepted");
  EXPECT_THAT(with({"sensor.send_max_age_s=0.04"}),
              HasSubstr("sensor.send_max_age_s = 0.04 is below the time between two poses"));
  EXPECT_THAT(with({"sensor.send_max_age_s=1"}),
              HasSubstr("sensor.send_max_age_s = 1 must be below controller.pose_timeout_s = 1"));
  EXPECT_EQ(with({"sensor.send_max_age_s=1", "controller.pose_timeout_s=0"}), "accepted");
  EXPECT_EQ(
      with({"sensor.send_max_age_s=0.7", "sensor.latency_ms=100", "channel.uplink.delay_ms=199"}),
      "accepted");
  EXPECT_THAT(
      with({"sensor.send_max_age_s=0.7", "sensor.latency_ms=100", "channel.uplink.delay_ms=200"}),
      HasSubstr("sensor.send_max_age_s = 0.7 and the 0.3 s that a pose takes "
                "(sensor.latency_ms and the uplink's delay) must be below "
                "controller.pose_timeout_s = 1"));
  EXPECT_EQ(with({"actuator.policy=zero"}), "accepted") << "0.4 s of 0.5 s";
  EXPECT_THAT(with({"actuator.policy=zero", "sensor.send_max_age_s=0.5"}),
              HasSubstr("actuator.timeout_s = 0.5 must be above the longest time between two "
                        "commands, 0.5 s"));
  EXPECT_THAT(with({"actuator.policy=zero", "controller.send=changed"}),
              HasSubstr("between two commands, 0.8 s"));
  EXPECT_EQ(with({"actuator.policy=zero", "controller.send=changed", "controller.trigger=timer"}),
            "accepted");
}

TEST(SendingChanges, OfPlansNeedsAnAgeLimitBelowTheirHorizon) {
  const std::vector<std::string> plans{"controller.send=changed", "actuator.policy=horizon",
                                       "controller.law=predictive", "controller.horizon_s=5"};
  EXPECT_EQ(switch_refusal(plans), "accepted");
  auto late = plans;
  late.emplace_back("controller.send_max_age_s=5");
  EXPECT_THAT(switch_refusal(late), HasSubstr("must be below controller.horizon_s = 5"));
}

TEST(SendingChanges, OfTwistsHasATimeoutUnderAPolicyForPlansToo) {
  const std::vector<std::string> twists{"controller.send=changed", "actuator.policy=horizon",
                                        "controller.trigger=timer"};
  EXPECT_EQ(switch_refusal(twists), "accepted");
  auto late = twists;
  late.emplace_back("controller.send_max_age_s=0.5");
  EXPECT_THAT(switch_refusal(late),
              HasSubstr("must be above the longest time between two commands, 0.5 s"));
}

TEST(SendingChanges, IsNoSilenceForTheBridge) {
  const auto by_can = [](const std::string& age, const std::string& law) {
    std::vector<std::string> keys{"vehicle.drivetrain=can", "can.drivetrain=x.toml",
                                  "controller.send=changed", "controller.send_max_age_s=" + age,
                                  "controller.law=" + law};
    if (law != "pid") keys.emplace_back("actuator.policy=horizon");
    return switch_refusal(keys);
  };
  EXPECT_EQ(by_can("0.19", "pid"), "accepted");
  EXPECT_THAT(by_can("0.2", "pid"), HasSubstr("must be below 0.2 s (can.stale_ms = 200)"));
  EXPECT_EQ(by_can("0.9", "predictive"), "accepted");
  EXPECT_THAT(by_can("1", "predictive"), HasSubstr("must be below 1 s (can.max_blind_s = 1)"));
}

TEST(SendingChanges, IsRefusedWhereItWouldDoNothingOrOthersNeedAll) {
  EXPECT_THAT(switch_refusal({"sensor.send=changed", "medium.model=dcf", "medium.others=3"}),
              HasSubstr("test.toml: sensor.send = \"changed\" needs medium.others = 0"));
  EXPECT_THAT(
      switch_refusal({"controller.send=changed", "autonomy.enabled=true", "lidar.model=custom",
                      "sensor.odometry_rate_hz=50", "controller.law=detour"}),
      HasSubstr("controller.send = \"changed\" needs autonomy.enabled = false"));
  EXPECT_THAT(switch_refusal({"sensor.send=changed", "localiser.place=vehicle",
                              "lidar.model=custom", "sensor.odometry_rate_hz=50"}),
              HasSubstr("needs localiser.place = \"none\""));
  EXPECT_THAT(switch_refusal({"sensor.send=seldom"}),
              HasSubstr("must be \"always\" or \"changed\""));
}

TEST(SendingChanges, IsInTheResolvedScenarioOnlyWhereItIsOn) {
  const auto resolved = [](const std::vector<std::string>& overrides) {
    return to_toml(parse_scenario("", "test.toml", overrides));
  };
  EXPECT_THAT(resolved({}), Not(HasSubstr("send")));
  EXPECT_THAT(resolved({"sensor.send=changed"}), HasSubstr("send_max_age_s = 0.4"));
}

}  // namespace
}  // namespace tether
