#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"
#include "onboard/autonomy/supervisor.hpp"

namespace tether {
namespace {

constexpr Outline kChassis{-0.5, 1.5, 0.7};
constexpr Setpoint::Limits kLimits{1.0, 2.0};
constexpr double kCycle_s = 0.02;

TEST(Setpoint, ReachesATargetWithinItsAcceleration) {
  Setpoint setpoint(kLimits, kChassis);
  for (int i = 0; i < 50; ++i) setpoint.step({1.0, 0.2}, 5.0, kCycle_s);
  EXPECT_NEAR(setpoint.twist().v_mps, 1.0, 1e-9);
  EXPECT_NEAR(setpoint.twist().omega_radps, 0.2, 1e-9);
}

TEST(Setpoint, BrakesOnItsArc) {
  Setpoint setpoint(kLimits, kChassis);
  for (int i = 0; i < 100; ++i) setpoint.step({1.0, 0.5}, 5.0, kCycle_s);
  int steps = 0;
  for (; !setpoint.stands(); ++steps) {
    const Twist u = setpoint.step({}, 5.0, kCycle_s);
    if (u.v_mps > 0.0) {
      EXPECT_NEAR(u.omega_radps / u.v_mps, 0.5, 1e-9);
    }
  }
  EXPECT_EQ(steps, 50) << "1 m/s at 1 m/s²";
}

TEST(Setpoint, SlowsDownToWhatIsAllowedAndNotBelow) {
  Setpoint setpoint(kLimits, kChassis);
  for (int i = 0; i < 100; ++i) setpoint.step({1.0, 0.0}, 5.0, kCycle_s);
  for (int i = 0; i < 100; ++i) setpoint.step({1.0, 0.0}, 0.4, kCycle_s);
  EXPECT_NEAR(setpoint.twist().v_mps, 0.4, 1e-9);
}

TEST(Setpoint, NeverJumpsAndIsNeverFasterThanAllowedForLongerThanItBrakes) {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    RandomEngine random = random_stream(seed, "setpoint_test");
    const auto between = [&random](double a, double b) { return a + (b - a) * uniform_01(random); };
    Setpoint setpoint(kLimits, kChassis);
    Twist target;
    double allowed_mps = 1.0;
    for (int i = 0; i < 500; ++i) {
      if (uniform_01(random) < 0.05) target = {between(-2.0, 2.0), between(-1.5, 1.5)};
      if (uniform_01(random) < 0.05) target = {};
      if (uniform_01(random) < 0.05)
        allowed_mps = uniform_01(random) < 0.3 ? 0.0 : between(0.0, 2.0);
      const Twist before = setpoint.twist();
      const Twist u = setpoint.step(target, allowed_mps, kCycle_s);
      ASSERT_LE(std::abs(u.v_mps - before.v_mps), 1.0 * kCycle_s + 1e-12);
      ASSERT_LE(std::abs(u.omega_radps - before.omega_radps), 2.0 * kCycle_s + 1e-12);
      const double was = pace_mps(before, kChassis), is = pace_mps(u, kChassis);
      ASSERT_LE(is, std::max(allowed_mps, was - 1.0 * kCycle_s) + 1e-12);
    }
  }
}

}  // namespace
}  // namespace tether
