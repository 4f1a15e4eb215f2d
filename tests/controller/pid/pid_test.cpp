#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "common/path/simple_curves.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/pid_law.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_s;

constexpr double kPi = 3.14159265358979323846;

TEST(Pid, ProportionalPartIsGainTimesError) {
  Pid pid({.p = 2.0, .limit = 100.0});
  EXPECT_DOUBLE_EQ(pid.step(1.5, 0.1), 3.0);
  EXPECT_DOUBLE_EQ(pid.step(-4.0, 0.1), -8.0);
}

TEST(Pid, FirstStepHasNoDerivative) {
  Pid pid({.d = 10.0, .limit = 100.0});
  EXPECT_DOUBLE_EQ(pid.step(5.0, 0.1), 0.0);
}

TEST(Pid, UnfilteredDerivativeIsTheDifferenceQuotient) {
  Pid pid({.d = 2.0, .limit = 100.0});
  pid.step(1.0, 0.1);
  EXPECT_DOUBLE_EQ(pid.step(1.5, 0.25), 2.0 * 0.5 / 0.25);
}

TEST(Pid, DerivativeFilterDecaysByBackwardEulerAfterAStep) {
  Pid pid({.d = 1.0, .limit = 100.0, .derivative_filter_s = 0.3});
  pid.step(0.0, 0.1);
  // A step of 1 in the error: d/dt e_f = (1 − e_f)/(T + dt), e_f starting from 0.
  EXPECT_NEAR(pid.step(1.0, 0.1), 1.0 / 0.4, 1e-12);
  EXPECT_NEAR(pid.step(1.0, 0.1), 0.75 / 0.4, 1e-12);
  EXPECT_NEAR(pid.step(1.0, 0.1), 0.75 * 0.75 / 0.4, 1e-12);
}

TEST(Pid, IntegralGrowsWithErrorAndTime) {
  Pid pid({.i = 0.5, .limit = 100.0});
  pid.step(2.0, 0.0);
  EXPECT_DOUBLE_EQ(pid.step(2.0, 1.0), 1.0);
  EXPECT_DOUBLE_EQ(pid.step(2.0, 1.0), 2.0);
}

TEST(Pid, OutputIsLimitedOnBothSides) {
  Pid pid({.p = 10.0, .limit = 2.0});
  EXPECT_DOUBLE_EQ(pid.step(1.0, 0.1), 2.0);
  EXPECT_DOUBLE_EQ(pid.step(-1.0, 0.1), -2.0);
}

TEST(Pid, IntegralDoesNotWindUpWhileSaturated) {
  Pid pid({.p = 1.0, .i = 1.0, .limit = 1.0});
  for (int i = 0; i < 1000; ++i) EXPECT_DOUBLE_EQ(pid.step(5.0, 0.1), 1.0);
  // Without anti-windup the integral would be 500 and hold the output at +1 for 100 s.
  EXPECT_LT(pid.step(-0.5, 0.1), 0.0);
}

TEST(Pid, IntegralMayUnwindWhileSaturated) {
  Pid pid({.p = 0.0, .i = 1.0, .limit = 1.0});
  pid.step(0.9, 0.0);
  for (int i = 0; i < 10; ++i) pid.step(0.9, 0.1);  // integral 0.9
  const double before = pid.step(0.0, 0.1);
  EXPECT_LT(pid.step(-0.9, 0.1), before);
}

TEST(Pid, AngularErrorCrossingPiGivesASmallDerivative) {
  Pid pid({.d = 1.0, .limit = 100.0, .angular = true});
  pid.step(kPi - 0.01, 0.1);
  EXPECT_NEAR(pid.step(-kPi + 0.01, 0.1), 0.02 / 0.1, 1e-9);
}

TEST(Pid, NoTimePassedKeepsTheDerivative) {
  Pid pid({.d = 1.0, .limit = 100.0});
  pid.step(0.0, 0.1);
  const double moving = pid.step(1.0, 0.5);
  EXPECT_DOUBLE_EQ(pid.step(1.0, 0.0), moving);
}

TEST(Pid, ResetMakesTheNextStepAFirstOne) {
  Pid pid({.p = 1.0, .i = 1.0, .d = 1.0, .limit = 100.0});
  pid.step(1.0, 0.1);
  pid.step(2.0, 0.1);
  pid.reset();
  EXPECT_DOUBLE_EQ(pid.step(3.0, 20.0), 3.0);  // the 20 s before it do not count
}

ControllerSettings proportional() {
  ControllerSettings c;
  c.tau_s = 2.0;
  c.v = {1.0, 0.0, 0.0, 100.0};
  c.omega = {1.0, 0.0, 0.0, 100.0};
  c.derivative_filter_s = 0.0;
  return c;
}

TEST(PidLaw, AimsAtThePathTauSecondsAhead) {
  const auto path = std::make_shared<FigureEight>(FigureEight::Config{});
  PidLaw law(proportional(), path);
  const PathPoint target = path->at(5.0 + 2.0);
  const Pose2 pose{3.0, -1.0, 0.4};
  const Twist u = law.step(pose, at_s(5.0));
  EXPECT_NEAR(u.v_mps, std::hypot(target.x_m - 3.0, target.y_m + 1.0), 1e-12);
  EXPECT_NEAR(u.omega_radps, std::atan2(target.y_m + 1.0, target.x_m - 3.0) - 0.4, 1e-12);
}

TEST(PidLaw, WrapsTheHeadingError) {
  PidLaw law(proportional(), std::make_shared<FigureEight>(FigureEight::Config{}));
  // At t = 0 the target lies along +x; a vehicle that looks to −x + a little has θ_e just below π.
  law.step({0.0, 0.0, kPi - 0.1}, kStart);
  EXPECT_GT(std::abs(law.errors().heading_rad), 2.9);
  EXPECT_LE(std::abs(law.errors().heading_rad), kPi);
}

TEST(PidLaw, TurnsTheLongWayRoundWithoutWrapping) {
  ControllerSettings config = proportional();
  config.wrap_heading = false;
  PidLaw law(config, std::make_shared<FigureEight>(FigureEight::Config{}));
  // At t = 1 s the path lies at a slightly negative bearing.
  law.step({-5.0, 0.1, kPi - 0.1}, at_s(1.0));
  EXPECT_LT(law.errors().heading_rad, -(kPi - 0.2));
  law.step({40.0, 1.0, kPi - 0.1}, at_s(1.0));
  EXPECT_GT(std::abs(law.errors().heading_rad), kPi);
}

TEST(PidLaw, DrivesForwardOnly) {
  PidLaw law(proportional(), std::make_shared<FigureEight>(FigureEight::Config{}));
  for (double yaw = -3.0; yaw <= 3.0; yaw += 0.5) {
    EXPECT_GE(law.step({10.0, 10.0, yaw}, at_s(1.0)).v_mps, 0.0);
  }
}

}  // namespace
}  // namespace tether
