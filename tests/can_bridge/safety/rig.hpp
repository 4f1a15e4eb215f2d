#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>

#include "can_bridge/safety/safety_core.hpp"

namespace tether::test {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

constexpr Duration kTick = nanoseconds{1};
constexpr Duration kCycle = milliseconds{20};
constexpr Duration kStale = milliseconds{200};
constexpr Duration kDisarm = milliseconds{500};

/// A safety core, its inputs, and drives that obey: what it decides in one cycle, the next
/// snapshot shows. Time begins at 100 s; the bus is up, the drives stand in standby.
struct SafetyRig : ::testing::Test {
  using Action = Decision::Action;

  Instant now = kStart + seconds{100};
  DrivetrainSnapshot drives;
  CanState bus = CanState::up;
  SafetyCore core{config()};
  Decision last;
  bool drives_obey = true;
  double driven_m = 0.0;  ///< by the setpoints
  std::int64_t command_seq = 0;
  std::int64_t request_seq = 0;

  SafetyRig() {
    drives.phase = DrivePhase::standby;
    drives.standstill = true;
    drives.feedback_fresh = true;
    cycle();
  }
  static SafetyCore::Config config() {
    SafetyCore::Config config;
    config.stale = kStale;
    config.disarm = kDisarm;
    config.limits.cycle = kCycle;
    return config;
  }

  void command(double v_mps, double omega_radps = 0.0) {
    core.on_command(now, now, command_seq++, {v_mps, omega_radps});
  }
  void request(DriveRequest r) {
    core.on_request(now, now, request_seq++, static_cast<std::int32_t>(r));
  }
  /// One cycle at `now`, which does not go on by itself.
  const Decision& cycle() {
    last = core.cycle(now, drives, bus, driven_m);
    driven_m += std::abs(last.twist.v_mps) * to_seconds(kCycle);
    if (drives_obey) obey(last.action);
    return last;
  }
  const Decision& cycle_after(Duration d) {
    now += d;
    return cycle();
  }
  void obey(Action action) {
    const bool on = drives.phase == DrivePhase::enabled || drives.phase == DrivePhase::enabling;
    if (drives.phase == DrivePhase::enabling) drives.phase = DrivePhase::enabled;
    if (drives.phase == DrivePhase::stopping && drives.standstill) {
      drives.phase = DrivePhase::standby;
    }
    if (action == Action::enable) drives.phase = DrivePhase::enabling;
    if (action == Action::quick_stop && on) drives.phase = DrivePhase::stopping;
    if (action == Action::disable) drives.phase = DrivePhase::standby;
    if (action == Action::reset_fault &&
        (drives.phase == DrivePhase::faulted || drives.phase == DrivePhase::refused)) {
      drives.phase = DrivePhase::starting;
    }
  }

  /// Presses ARM with a fresh zero command and runs until armed.
  void arm() {
    command(0.0);
    request(DriveRequest::arm);
    ASSERT_EQ(cycle().state, BridgeState::arming) << last.reason;
    for (int i = 0; i < 3 && last.state != BridgeState::armed; ++i) cycle_after(kCycle);
    ASSERT_EQ(last.state, BridgeState::armed) << last.reason;
  }
  /// Armed, and up to a speed, with a command that is as old as the last cycle: 0 ms.
  void drive(double v_mps, double omega_radps = 0.0) {
    arm();
    for (int i = 0; i < 200; ++i) {
      now += kCycle;
      command(v_mps, omega_radps);
      cycle();
    }
    ASSERT_NEAR(last.twist.v_mps, v_mps, 1e-9);
    drives.standstill = false;
  }
  /// For one cycle the wheels turn as they were last told.
  void turn_wheels() {
    for (WheelFeedback& wheel : drives.wheels) {
      wheel.speed_radps = last.twist.v_mps / 0.4;
      wheel.angle_rad += wheel.speed_radps * to_seconds(kCycle);
    }
  }
  /// Both encoders freeze: speed and position.
  void freeze_wheels() {
    for (WheelFeedback& wheel : drives.wheels) wheel.speed_radps = 0.0;
  }
  /// Cycles, `n` of them, with a fresh command before each.
  void keep_commanding(int n, double v_mps, double omega_radps = 0.0) {
    for (int i = 0; i < n; ++i) {
      now += kCycle;
      command(v_mps, omega_radps);
      cycle();
    }
  }

  void expect_no_motion() const {
    EXPECT_FALSE(last.may_move);
    EXPECT_EQ(last.twist.v_mps, 0.0);
    EXPECT_EQ(last.twist.omega_radps, 0.0);
  }
  void expect_reason(const std::string& part) const {
    EXPECT_NE(last.reason.find(part), std::string::npos) << "reason: " << last.reason;
  }
  /// An ARM with a fresh zero command changes nothing and moves nothing.
  void expect_cannot_be_armed() {
    const BridgeState before = last.state;
    for (int i = 0; i < 5; ++i) {
      now += kCycle;
      command(0.0);
      request(DriveRequest::arm);
      cycle();
      EXPECT_EQ(last.state, before);
      EXPECT_NE(last.action, Action::enable);
      expect_no_motion();
    }
  }
};

}  // namespace tether::test
