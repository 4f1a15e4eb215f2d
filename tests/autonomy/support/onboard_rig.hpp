#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "common/base/counters.hpp"
#include "common/scenario/scenario.hpp"
#include "onboard/autonomy/onboard_driver.hpp"
#include "tests/autonomy/support/scanner.hpp"

namespace tether::test {

/// A vehicle that drives by itself on a line from the middle of a hall, whose wheels do at once
/// what it says. No setpoint is farther from the one before than its limits allow.
class OnboardRig : public ::testing::Test {
 protected:
  static constexpr Duration kStep = std::chrono::milliseconds{20};
  static constexpr double kStep_s = 0.02;

  explicit OnboardRig(const std::string& policy = "horizon")
      : settings_(parse_scenario(R"(
[sensor]
odometry_rate_hz = 50.0
[path]
kind = "line"
length_m = 8.0
speed_mps = 1.2
[lidar]
model = "custom"
[controller]
law = "detour"
[autonomy]
enabled = true
)",
                                 "test", {"actuator.policy=" + policy})),
        driver_(settings_) {}

  void pass(double duration_s) {
    const Instant end = now_ + from_seconds(duration_s);
    while (now_ < end) {
      now_ += kStep;
      const Pose2 by_wheels{pose_.x_m + slipped_m_, pose_.y_m, pose_.yaw_rad};
      driver_.on_odometry(now_, by_wheels, wheels_.value_or(out_.setpoint));
      if (localised_) driver_.on_pose(now_, pose_);
      if (sees_ && (now_ - kStart) / kStep % 4 == 0) {
        driver_.on_scan(scanner_.scan(now_, pose_, shapes_));
      }
      const Twist before = out_.setpoint;
      out_ = driver_.step(now_);
      const auto& limits = settings_.get<AutonomySettings>();
      EXPECT_LE(std::abs(out_.setpoint.v_mps - before.v_mps),
                limits.deceleration_mps2 * kStep_s + 1e-9);
      EXPECT_LE(std::abs(out_.setpoint.omega_radps - before.omega_radps),
                limits.yaw_acceleration_radps2 * kStep_s + 1e-9);
      const Twist rolls = wheels_.value_or(out_.setpoint);
      if (held_) {
        slipped_m_ += rolls.v_mps * kStep_s;
      } else {
        pose_ = moved(pose_, rolls, kStep_s);
      }
    }
  }
  /// A box whose near side is this far ahead of the vehicle's front.
  void block(double ahead_m) { shapes_.push_back(box(pose_.x_m + 1.7 + ahead_m, 0.0, 0.4, 0.4)); }
  /// Blocked for long, the vehicle asks.
  void ask() {
    block(0.3);
    pass(settings_.get<AutonomySettings>().wait_s + 0.3);
    ASSERT_EQ(out_.state, DriveState::remote_requested);
  }
  std::int64_t counter(const std::string& name) const {
    CounterList all;
    driver_.list(all);
    const auto found = std::find_if(all.begin(), all.end(),
                                    [&name](const auto& entry) { return entry.first == name; });
    return found == all.end() ? -1 : found->second;
  }

  Scenario settings_;
  OnboardDriver driver_;
  Scanner scanner_;
  std::vector<Shape> shapes_ = hall(12.0);
  bool localised_ = true, sees_ = true;
  std::optional<Twist> wheels_;  ///< if not what it says
  bool held_ = false;            ///< its wheels turn, and it stays where it is
  double slipped_m_ = 0.0;
  OnboardDriver::Output out_;
  Pose2 pose_;
  Instant now_ = kStart;
  std::int64_t seq_ = 0;
};

}  // namespace tether::test
