#include <gtest/gtest.h>

#include "can_bridge/safety/twist_limiter.hpp"
#include "tests/can_bridge/safety/random_limits.hpp"

// How far the vehicle goes until it has slowed down: not farther because the target has yaw.

namespace tether {
namespace {

using test::Random;
using test::random_limits;
using test::uniform;

constexpr double kRounding = 1e-9;

/// The way from now on, until v has arrived at `target`.
double braking_way_m(TwistLimiter limiter, const TwistLimits& limits, const Twist& target) {
  double way_m = 0.0;
  for (int n = 0; n < 100'000 && limiter.twist().v_mps > target.v_mps + kRounding; ++n) {
    way_m += limiter.step(target).v_mps * to_seconds(limits.cycle);
  }
  return way_m;
}

TEST(TwistLimiter, BrakesFromAMeterASecondOnTheSameWayWhateverTheYawOfTheTarget) {
  TwistLimits limits;
  limits.max_yaw_acceleration_radps2 = limits.max_yaw_deceleration_radps2 = 0.1;
  TwistLimiter limiter{limits};
  for (int n = 0; n < 200; ++n) limiter.step({1.0, 0.0});
  const double straight_m = braking_way_m(limiter, limits, {});
  EXPECT_NEAR(straight_m, 1.0 / (2.0 * 1.5), 0.04);
  EXPECT_NEAR(braking_way_m(limiter, limits, {0.0, 2.0}), straight_m, kRounding);
}

TEST(TwistLimiter, YawNeverLengthensTheBrakingWay) {
  Random random(8);
  for (int trial = 0; trial < 300; ++trial) {
    const TwistLimits limits = random_limits(random);
    TwistLimiter limiter{limits};
    const Twist from{uniform(random, 0.1, 5.0), 0.0};
    for (int n = 0;
         n < 20'000 && limiter.twist().v_mps < limiter.within_speed_limits(from).v_mps - kRounding;
         ++n) {
      limiter.step(from);
    }
    const Twist straight{uniform(random, 0.0, 0.9) * limiter.twist().v_mps, 0.0};
    Twist turning = straight;
    turning.omega_radps = uniform(random, -4.0, 4.0);
    turning = limiter.within_speed_limits(turning);
    EXPECT_LE(braking_way_m(limiter, limits, turning),
              braking_way_m(limiter, limits, {turning.v_mps, 0.0}) + kRounding)
        << "trial " << trial;
  }
}

TEST(TwistLimiter, AYawRateFallsWithoutWaitingForASpeedThatRises) {
  TwistLimits limits;
  limits.max_acceleration_mps2 = 0.1;
  TwistLimiter limiter{limits};
  for (int n = 0; n < 200; ++n) limiter.step({0.0, 1.5});
  int cycles = 0;
  for (; limiter.twist().omega_radps > 0.0; ++cycles) limiter.step({2.0, 0.0});
  EXPECT_NEAR(cycles * 0.02, 1.5 / 3.0, 0.1);
}

}  // namespace
}  // namespace tether
