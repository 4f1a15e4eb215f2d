#include "can_bridge/safety/ramp_watch.hpp"

#include <gtest/gtest.h>

#include "tests/can_bridge/safety/rig.hpp"

namespace tether {
namespace {

using test::milliseconds;
using test::SafetyRig;

constexpr double kDeceleration_mps2 = 2.0, kYawDeceleration_radps2 = 4.0;

/// When a vehicle that brakes at these rates is found not to; −1: never.
int noticed_ms(Twist from, Twist rate) {
  RampWatch watch(kDeceleration_mps2, kYawDeceleration_radps2);
  for (int ms = 0; ms < 3000; ms += 20) {
    const double t = ms * 1e-3;
    const Twist u{std::max(from.v_mps - rate.v_mps * t, 0.0),
                  std::max(from.omega_radps - rate.omega_radps * t, 0.0)};
    if (!watch.brakes(kStart + milliseconds(ms), {}, u)) return ms;
  }
  return -1;
}

TEST(RampWatch, AVehicleThatDoesNotBrakeIsNoticedWithinAFewCyclesOf150Ms) {
  EXPECT_EQ(noticed_ms({1.0, 0.0}, {0.0, 0.0}), 220);  // 0.05 m/s at 1 m/s²
  EXPECT_EQ(noticed_ms({0.0, 1.0}, {0.0, 0.0}), 260);  // 0.2 rad/s at 2 rad/s²
}

TEST(RampWatch, HalfOfTheConfiguredDecelerationIsEnoughAndLessIsNot) {
  EXPECT_EQ(noticed_ms({1.0, 1.0}, {1.0, 2.0}), -1);
  EXPECT_GT(noticed_ms({1.0, 1.0}, {0.8, 2.0}), 0);
  EXPECT_GT(noticed_ms({1.0, 1.0}, {1.0, 1.2}), 0);
}

TEST(RampWatch, WhatStillSpeedsUpMeanwhileIsBrakedFromThere) {
  RampWatch watch(kDeceleration_mps2, kYawDeceleration_radps2);
  EXPECT_TRUE(watch.brakes(kStart, {}, {1.0, 0.0}));
  EXPECT_TRUE(watch.brakes(kStart + milliseconds(100), {}, {1.1, 0.0}));
  EXPECT_TRUE(watch.brakes(kStart + milliseconds(160), {}, {1.1, 0.0}));
  EXPECT_FALSE(watch.brakes(kStart + milliseconds(260), {}, {1.1, 0.0}));
}

TEST(RampWatch, AYawRateThatFallsSlowlyBecauseTheCurveIsKeptBrakes) {
  RampWatch watch(kDeceleration_mps2, kYawDeceleration_radps2);
  for (int ms = 0; ms <= 1000; ms += 20) {
    const double left = 1.0 - ms * 1e-3;
    const Twist u{2.0 * left, 0.5 * left};
    EXPECT_TRUE(watch.brakes(kStart + milliseconds(ms), u, u)) << ms;
  }
}

TEST(RampWatch, EachRampIsJudgedFromItsOwnBeginning) {
  RampWatch watch(kDeceleration_mps2, kYawDeceleration_radps2);
  EXPECT_TRUE(watch.brakes(kStart, {}, {1.0, 0.0}));
  watch.end();
  EXPECT_TRUE(watch.brakes(kStart + milliseconds(500), {}, {1.0, 0.0}));
}

struct Ramp : SafetyRig {
  /// The wheels go on at 1 m/s, whatever their setpoint.
  void wheels_run_on() {
    drive(1.0);
    for (WheelFeedback& wheel : drives.wheels) wheel.fastest_radps = 1.0 / 0.4;
    drives.turning = true;
  }
};

TEST_F(SafetyRig, AVehicleThatWasPushedWhileItsDrivesWereSwitchedOnIsNotArmed) {
  command(0.0);
  request(DriveRequest::arm);
  ASSERT_EQ(cycle().state, BridgeState::arming);
  drives.standstill = false;
  for (int i = 0; i < 5; ++i) {
    now += test::kCycle;
    command(0.0);
    cycle();
    EXPECT_NE(last.state, BridgeState::armed);
  }
  expect_reason("the wheels turned when the drives were on");
}

TEST_F(Ramp, OfADisarmThatDoesNotBrakeBecomesAQuickStopAndAFault) {
  wheels_run_on();
  request(DriveRequest::disarm);
  int ms = 0;
  for (; ms < 1000 && last.action != Action::quick_stop; ms += 20) {
    now += milliseconds(20);
    command(1.0);
    cycle();
  }
  EXPECT_LE(ms, 300);
  cycle_after(test::kCycle);
  expect_reason("does not brake on the ramp");
}

TEST_F(Ramp, OnAStaleCommandThatDoesNotBrakeBecomesAQuickStopBeforeTheDisarm) {
  wheels_run_on();
  int ms = 0;
  for (; ms < 1000 && last.action != Action::quick_stop; ms += 20) cycle_after(milliseconds(20));
  EXPECT_GT(ms, 200 + 150);
  EXPECT_LT(ms, 500);
  cycle_after(test::kCycle);
  expect_reason("does not brake on the ramp");
}

}  // namespace
}  // namespace tether
