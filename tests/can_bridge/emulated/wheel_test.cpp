#include <gtest/gtest.h>

#include <cmath>

#include "can_bridge/emulated/wheel_model.hpp"

namespace tether {
namespace {

constexpr Duration kMs = std::chrono::milliseconds{1};

WheelModel::Config plain() {
  return {.inertia_kgm2 = 0.4,
          .max_torque_Nm = 4.0,
          .friction_Nm = 0.0,
          .lag_s = 0.002,
          .gain_Nms = 50.0};
}

void run(WheelModel& wheel, double target_radps, int milliseconds) {
  for (int i = 0; i < milliseconds; ++i) wheel.step(target_radps, kMs);
}

TEST(WheelModel, AcceleratesNoFasterThanTorqueOverInertia) {
  WheelModel wheel(plain());
  run(wheel, 100.0, 500);
  // 10 rad/s² from the start, less what the lag of 2 ms costs
  EXPECT_LE(wheel.speed_radps(), 5.0);
  EXPECT_NEAR(wheel.speed_radps(), 5.0 - 10.0 * 0.002, 0.01);
  EXPECT_NEAR(wheel.angle_rad(), 0.5 * 10.0 * 0.25, 0.02);
}

TEST(WheelModel, SettlesOnItsTargetWithoutOvershoot) {
  WheelModel wheel(plain());
  double fastest = 0.0;
  for (int i = 0; i < 1000; ++i) {
    wheel.step(2.0, kMs);
    fastest = std::max(fastest, wheel.speed_radps());
  }
  EXPECT_NEAR(wheel.speed_radps(), 2.0, 1e-6);
  EXPECT_LT(fastest, 2.02);
}

TEST(WheelModel, UnderFrictionItStaysBehindByFrictionOverGain) {
  WheelModel::Config config = plain();
  config.friction_Nm = 0.5;
  WheelModel wheel(config);
  run(wheel, 2.0, 2000);
  EXPECT_NEAR(wheel.speed_radps(), 2.0 - 0.5 / 50.0, 1e-3);
}

TEST(WheelModel, FrictionHoldsAStandingWheel) {
  WheelModel::Config config = plain();
  config.friction_Nm = 0.5;
  WheelModel wheel(config);
  run(wheel, 0.0099, 1000);  // demands 0.495 Nm
  EXPECT_EQ(wheel.speed_radps(), 0.0);
  EXPECT_EQ(wheel.angle_rad(), 0.0);
  run(wheel, 0.02, 1000);
  EXPECT_GT(wheel.angle_rad(), 0.0);
}

TEST(WheelModel, BrakesToAStandAndStays) {
  WheelModel wheel(WheelModel::of({}));
  run(wheel, 3.0, 1000);
  ASSERT_GT(wheel.speed_radps(), 2.9);
  run(wheel, 0.0, 1000);
  EXPECT_EQ(wheel.speed_radps(), 0.0);
}

TEST(WheelModel, LongStepsAreTakenInMilliseconds) {
  WheelModel a(plain()), b(plain());
  a.step(3.0, std::chrono::milliseconds{40});
  run(b, 3.0, 40);
  EXPECT_DOUBLE_EQ(a.angle_rad(), b.angle_rad());
  EXPECT_DOUBLE_EQ(a.speed_radps(), b.speed_radps());
}

}  // namespace
}  // namespace tether
