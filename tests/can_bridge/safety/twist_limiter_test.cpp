#include "can_bridge/safety/twist_limiter.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "tests/can_bridge/safety/random_limits.hpp"

namespace tether {
namespace {

using test::kFastest;
using test::Random;
using test::random_limits;
using test::uniform;

constexpr double kLimiterRounding = 1e-9;

double seconds_per_cycle(const TwistLimits& limits) { return to_seconds(limits.cycle); }

double fastest_wheel(const Twist& twist, double track_m) {
  const WheelSpeeds w = to_wheel_speeds(twist, track_m);
  return std::max(std::abs(w.left_mps), std::abs(w.right_mps));
}

struct Axis {
  double acceleration, deceleration, jerk;
};
Axis v_axis(const TwistLimits& l) {
  return {l.max_acceleration_mps2, l.max_deceleration_mps2, l.max_jerk_mps3};
}
Axis w_axis(const TwistLimits& l) {
  return {l.max_yaw_acceleration_radps2, l.max_yaw_deceleration_radps2, l.max_yaw_jerk_radps3};
}
/// The jerk that a stop may use, from the documentation.
double stop_jerk(const Axis& axis) {
  return std::max(axis.jerk, (1.5 * axis.acceleration + axis.deceleration) /
                                 to_seconds(TwistLimiter::kStopJerkDelay));
}

/// Steps a limiter and checks every limit in every cycle.
class Watched {
 public:
  explicit Watched(const TwistLimits& limits) : limits_(limits), limiter_(limits) {}

  void step(const Twist& target) {
    check(limiter_.step(target), stopped_lately_);
    if (limiter_.at_rest()) stopped_lately_ = false;
  }
  void stop() {
    stopped_lately_ = true;
    check(limiter_.stop(), true);
  }
  const TwistLimiter& limiter() const { return limiter_; }
  Twist twist() const { return limiter_.twist(); }

 private:
  void check(const Twist& now, bool stop_jerk_allowed) {
    EXPECT_LE(now.v_mps, limits_.max_speed_mps + kLimiterRounding);
    EXPECT_GE(now.v_mps, -limits_.max_reverse_mps - kLimiterRounding);
    EXPECT_LE(std::abs(now.omega_radps), limits_.max_yaw_rate_radps + kLimiterRounding);
    EXPECT_LE(fastest_wheel(now, limits_.track_m), limits_.max_wheel_speed_mps + kLimiterRounding);
    check_axis(before_.v_mps, now.v_mps, v_rate_, v_axis(limits_), stop_jerk_allowed);
    check_axis(before_.omega_radps, now.omega_radps, w_rate_, w_axis(limits_), stop_jerk_allowed);
    before_ = now;
  }
  void check_axis(double before, double now, double& rate, const Axis& axis, bool stop_allowed) {
    const double dt = seconds_per_cycle(limits_);
    const double new_rate = (now - before) / dt;
    const bool slowing = std::abs(now) < std::abs(before) && now * before >= -1e-12;
    EXPECT_LE(std::abs(new_rate), (slowing ? axis.deceleration : axis.acceleration) + 1e-6)
        << before << " -> " << now;
    EXPECT_LE(std::abs(new_rate - rate) / dt, (stop_allowed ? stop_jerk(axis) : axis.jerk) + 1e-6)
        << before << " -> " << now;
    rate = new_rate;
  }

  TwistLimits limits_;
  TwistLimiter limiter_;
  Twist before_;
  double v_rate_ = 0.0;
  double w_rate_ = 0.0;
  bool stopped_lately_ = false;
};

Twist random_target(Random& random) {
  Twist t{uniform(random, -5.0, 5.0), uniform(random, -4.0, 4.0)};
  if (uniform(random, 0.0, 1.0) < 0.2) t.v_mps = 0.0;
  if (uniform(random, 0.0, 1.0) < 0.2) t.omega_radps = 0.0;
  return t;
}

bool arrived(const Twist& actual, const Twist& target) {
  return std::abs(actual.v_mps - target.v_mps) <= kLimiterRounding &&
         std::abs(actual.omega_radps - target.omega_radps) <= kLimiterRounding;
}

void expect_twist(const Twist& actual, const Twist& expected) {
  EXPECT_NEAR(actual.v_mps, expected.v_mps, kLimiterRounding);
  EXPECT_NEAR(actual.omega_radps, expected.omega_radps, kLimiterRounding);
}

TEST(TwistLimiter, RestsUntilItIsGivenATarget) {
  TwistLimiter limiter{TwistLimits{}};
  EXPECT_TRUE(limiter.at_rest());
  expect_twist(limiter.step({}), {0.0, 0.0});
  expect_twist(limiter.stop(), {0.0, 0.0});
}

TEST(TwistLimiter, AStepInSpeedIsARampOfTheGivenJerkAndAcceleration) {
  TwistLimits limits;  // 1 m/s², 30 m/s³, 20 ms: the rate rises by 0.6 m/s² per cycle
  TwistLimiter limiter{limits};
  EXPECT_NEAR(limiter.step({1.0, 0.0}).v_mps, 0.6 * 0.02, kLimiterRounding);
  EXPECT_NEAR(limiter.step({1.0, 0.0}).v_mps, (0.6 + 1.0) * 0.02, kLimiterRounding);
  EXPECT_NEAR(limiter.step({1.0, 0.0}).v_mps, (0.6 + 2.0) * 0.02, kLimiterRounding);
}

TEST(TwistLimiter, BrakesHarderThanItAcceleratesIfToldSo) {
  TwistLimits limits;
  TwistLimiter limiter{limits};
  const auto cycles_to = [&limiter](double v_mps) {
    int n = 0;
    for (; limiter.twist().v_mps != v_mps; ++n) limiter.step({v_mps, 0.0});
    return n;
  };
  EXPECT_NEAR(cycles_to(2.0), 2.0 / 1.0 / 0.02 + 2, 1);  // and the jerk's share
  EXPECT_NEAR(cycles_to(0.0), 2.0 / 1.5 / 0.02 + 3, 1);
}

TEST(TwistLimiter, ATargetBeyondTheSpeedLimitsKeepsItsCurvature) {
  TwistLimits limits;
  limits.max_speed_mps = 2.0;
  limits.max_reverse_mps = 0.5;
  limits.max_yaw_rate_radps = 1.0;
  const TwistLimiter limiter{limits};
  expect_twist(limiter.within_speed_limits({4.0, 1.0}), {2.0, 0.5});
  expect_twist(limiter.within_speed_limits({-1.0, 1.0}), {-0.5, 0.5});
  expect_twist(limiter.within_speed_limits({1.0, -4.0}), {0.25, -1.0});
  expect_twist(limiter.within_speed_limits({1.9, 0.9}), {1.9, 0.9});
}

TEST(TwistLimiter, ATooFastWheelSlowsBothWheels) {
  TwistLimits limits;
  limits.max_wheel_speed_mps = 1.0;
  limits.track_m = 1.0;
  const TwistLimiter limiter{limits};
  const Twist twist = limiter.within_speed_limits({1.5, 1.0});  // wheels at 1 and 2 m/s
  EXPECT_NEAR(fastest_wheel(twist, 1.0), 1.0, kLimiterRounding);
  EXPECT_NEAR(twist.omega_radps / twist.v_mps, 1.0 / 1.5, kLimiterRounding);
}

TEST(TwistLimiter, BothAxesRiseInProportionSoThatTheCurveIsKept) {
  TwistLimiter limiter{TwistLimits{}};
  for (int n = 0; n < 500; ++n) {
    const Twist t = limiter.step({1.0, 0.8});
    ASSERT_NEAR(t.omega_radps, 0.8 * t.v_mps, kLimiterRounding) << "in cycle " << n;
  }
  expect_twist(limiter.twist(), {1.0, 0.8});
}

TEST(TwistLimiter, AStopKeepsTheCurveToo) {
  TwistLimiter limiter{TwistLimits{}};
  for (int n = 0; n < 500; ++n) limiter.step({2.0, -1.0});
  while (!limiter.at_rest()) {
    const Twist t = limiter.stop();
    ASSERT_NEAR(t.omega_radps, -0.5 * t.v_mps, kLimiterRounding);
  }
}

TEST(TwistLimiter, FromRestItArrivesWhenTheLimitsSayAndNotLater) {
  Random random(1);
  for (int trial = 0; trial < 300; ++trial) {
    const TwistLimits limits = random_limits(random);
    Watched watched(limits);
    const Twist target = watched.limiter().within_speed_limits(random_target(random));
    const double dv = std::abs(target.v_mps), dw = std::abs(target.omega_radps);
    if (dv == 0.0 && dw == 0.0) continue;
    const auto ratio = [](double limit, double d) { return d > 0.0 ? limit / d : 1e300; };
    const double f =
        std::min(ratio(v_axis(limits).acceleration, dv), ratio(w_axis(limits).acceleration, dw));
    const double g = std::min(ratio(v_axis(limits).jerk, dv), ratio(w_axis(limits).jerk, dw));
    const double expected_s = f * f < g ? 1.0 / f + f / g : 2.0 / std::sqrt(g);

    const double dt = seconds_per_cycle(limits);
    int cycles = 0;
    while (!arrived(watched.twist(), target) && cycles * dt < 2.0 * expected_s + 1.0) {
      watched.step(target);
      ++cycles;
    }
    // The staircase of rates is built upon whole cycles: the first takes effect at once.
    EXPECT_NEAR(cycles, expected_s / dt, 1.0 + 1e-6) << "trial " << trial;
  }
}

TEST(TwistLimiter, AConstantTargetIsNeverOvershotFromRestAndThenHeldForGood) {
  Random random(2);
  for (int trial = 0; trial < 200; ++trial) {
    Watched watched(random_limits(random));
    for (int target_number = 0; target_number < 3; ++target_number) {
      const Twist target = watched.limiter().within_speed_limits(random_target(random));
      const Twist from = watched.twist();
      const auto between = [](double x, double a, double b) {
        return x >= std::min(a, b) - kLimiterRounding && x <= std::max(a, b) + kLimiterRounding;
      };
      int n = 0;
      for (; n < 300'000; ++n) {
        watched.step(target);
        const Twist t = watched.twist();
        ASSERT_TRUE(between(t.v_mps, from.v_mps, target.v_mps)) << "trial " << trial;
        ASSERT_TRUE(between(t.omega_radps, from.omega_radps, target.omega_radps));
        if (arrived(t, target)) break;
      }
      ASSERT_LT(n, 300'000) << "trial " << trial << " did not arrive";
      for (int m = 0; m < 50; ++m) {
        watched.step(target);
        ASSERT_TRUE(arrived(watched.twist(), target)) << "trial " << trial;
      }
    }
  }
}

TEST(TwistLimiter, FromAnyMotionItSettlesOnAConstantTargetAndStays) {
  Random random(7);
  for (int trial = 0; trial < 500; ++trial) {
    const TwistLimits limits = random_limits(random);
    Watched watched(limits);
    const int before = std::uniform_int_distribution<int>(1, 300)(random);
    Twist target;
    for (int n = 0; n < before; ++n) {
      if (uniform(random, 0.0, 1.0) < 0.1) target = random_target(random);
      watched.step(target);
    }
    target = watched.limiter().within_speed_limits(random_target(random));
    // Turning the rate around, covering the way there (and, for a target that jumped nearer, back)
    // one axis after the other: what both need at most, were they not to share.
    double bound_s = 0.0;
    for (const Axis& a : {v_axis(limits), w_axis(limits)}) {
      const double turn_s = (a.acceleration + a.deceleration) / a.jerk;
      const double way = 2.0 * kFastest + turn_s * a.deceleration;
      bound_s += 2.0 * turn_s + way / a.acceleration + a.deceleration / a.jerk;
    }
    const double dt = seconds_per_cycle(limits);
    for (int n = 0; n < bound_s / dt + 1; ++n) watched.step(target);
    for (int m = 0; m < 50; ++m) {
      watched.step(target);
      ASSERT_TRUE(arrived(watched.twist(), target)) << "trial " << trial;
    }
  }
}

TEST(TwistLimiter, NoSequenceOfTargetsExceedsAnyLimit) {
  Random random(3);
  for (int trial = 0; trial < 200; ++trial) {
    Watched watched(random_limits(random));
    Twist target;
    for (int n = 0; n < 2000 && !::testing::Test::HasFailure(); ++n) {
      if (uniform(random, 0.0, 1.0) < 0.1) target = random_target(random);
      watched.step(target);
    }
    ASSERT_FALSE(::testing::Test::HasFailure()) << "trial " << trial;
  }
}

TEST(TwistLimiter, TargetsStopsAndResumptionsExceedNoLimitEither) {
  Random random(4);
  for (int trial = 0; trial < 200; ++trial) {
    Watched watched(random_limits(random));
    Twist target;
    bool stopping = false;
    for (int n = 0; n < 2000 && !::testing::Test::HasFailure(); ++n) {
      if (uniform(random, 0.0, 1.0) < 0.1) target = random_target(random);
      if (uniform(random, 0.0, 1.0) < 0.05) stopping = !stopping;
      if (stopping) {
        watched.stop();
      } else {
        watched.step(target);
      }
    }
    ASSERT_FALSE(::testing::Test::HasFailure()) << "trial " << trial;
  }
}

TEST(TwistLimiter, WhateverWentBeforeAStopEndsWithinTheDocumentedTime) {
  Random random(5);
  for (int trial = 0; trial < 2000; ++trial) {
    const TwistLimits limits = random_limits(random);
    Watched watched(limits);
    Twist target;
    const int before = std::uniform_int_distribution<int>(1, 300)(random);
    for (int n = 0; n < before; ++n) {
      if (uniform(random, 0.0, 1.0) < 0.1) target = random_target(random);
      watched.step(target);
    }
    const Twist from = watched.twist();
    const double bound_s =
        std::max(std::abs(from.v_mps) / limits.max_deceleration_mps2,
                 std::abs(from.omega_radps) / limits.max_yaw_deceleration_radps2) +
        to_seconds(TwistLimiter::kStopJerkDelay);
    int cycles = 0;
    while (!(watched.twist().v_mps == 0.0 && watched.twist().omega_radps == 0.0) &&
           cycles < 100'000) {
      watched.stop();
      ++cycles;
    }
    EXPECT_LE(cycles * seconds_per_cycle(limits), bound_s + 2.0 * seconds_per_cycle(limits) + 1e-9)
        << "trial " << trial;
  }
}

TEST(TwistLimiter, AStopNeverRollsBackward) {
  Random random(6);
  for (int trial = 0; trial < 300; ++trial) {
    Watched watched(random_limits(random));
    const Twist target = watched.limiter().within_speed_limits(
        {uniform(random, 0.1, 4.0), uniform(random, 0.1, 3.0)});
    for (int n = 0; n < 200; ++n) watched.step(target);
    for (int n = 0; n < 2000 && !watched.limiter().at_rest(); ++n) {
      watched.stop();
      ASSERT_GE(watched.twist().v_mps, -kLimiterRounding);
      ASSERT_GE(watched.twist().omega_radps, -kLimiterRounding);
    }
  }
}

TEST(TwistLimiter, ATinyJerkDoesNotDelayAStop) {
  TwistLimits limits;
  limits.max_jerk_mps3 = 0.1;  // alone, it would take 15 s to build up the brake
  TwistLimiter limiter{limits};
  for (int n = 0; n < 2000; ++n) limiter.step({1.0, 0.0});
  ASSERT_NEAR(limiter.twist().v_mps, 1.0, 1e-3);
  int cycles = 0;
  for (; limiter.twist().v_mps != 0.0; ++cycles) limiter.stop();
  EXPECT_LE(cycles * 0.02, 1.0 / 1.5 + 0.1 + 0.04);
}

TEST(TwistLimiterDeathTest, AStoppingLimitWeakerThanTheAcceleratingOneIsABug) {
  TwistLimits limits;
  limits.max_deceleration_mps2 = 0.99 * limits.max_acceleration_mps2;
  EXPECT_DEATH(TwistLimiter{limits}, "deceleration");
  limits = {};
  limits.max_yaw_deceleration_radps2 = 0.99 * limits.max_yaw_acceleration_radps2;
  EXPECT_DEATH(TwistLimiter{limits}, "deceleration");
}

TEST(TwistLimiter, TakesItsLimitsFromTheScenario) {
  Scenario scenario;
  scenario.get<CanSettings>().max_deceleration_mps2 = 7.0;
  scenario.get<CanSettings>().max_yaw_jerk_radps3 = 11.0;
  scenario.get<CanSettings>().cycle_ms = 10.0;
  scenario.get<VehicleSettings>().max_wheel_speed_mps = 3.5;
  scenario.get<VehicleSettings>().track_m = 0.9;
  const TwistLimits limits = twist_limits(scenario);
  EXPECT_EQ(limits.max_deceleration_mps2, 7.0);
  EXPECT_EQ(limits.max_yaw_jerk_radps3, 11.0);
  EXPECT_EQ(limits.cycle, std::chrono::milliseconds{10});
  EXPECT_EQ(limits.max_wheel_speed_mps, 3.5);
  EXPECT_EQ(limits.track_m, 0.9);
}

}  // namespace
}  // namespace tether
