#include "common/vehicle/grip.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace tether {
namespace {

constexpr double kGravity = 9.81;

VehicleConfig brush() {
  VehicleConfig v;
  v.tyre = VehicleConfig::Tyre::brush;
  return v;
}

TEST(Weight, IsThePapers) {
  const VehicleWeight w = vehicle_weight({});
  EXPECT_NEAR(w.mass_kg, 3.41275, 1e-9);
  EXPECT_NEAR(w.ahead_m, 0.27, 1e-4);  // C = -0.23, the axle is at -0.5
  EXPECT_EQ(w.left_m, 0.0);
  EXPECT_NEAR(w.height_m, 0.384, 1e-3);
}

TEST(Weight, APayloadMovesTheCentreOfMass) {
  VehicleConfig v;
  v.payload_kg = 3.41275;
  v.payload_x_m = 0.3;
  v.payload_y_m = 0.2;
  v.payload_z_m = 0.5;
  const VehicleWeight w = vehicle_weight(v);
  EXPECT_NEAR(w.mass_kg, 2.0 * 3.41275, 1e-9);
  EXPECT_NEAR(w.ahead_m, (0.27 + 0.8) / 2.0, 1e-4);
  EXPECT_NEAR(w.left_m, 0.1, 1e-9);
  EXPECT_NEAR(w.height_m, (0.384 + 0.9) / 2.0, 1e-3);
}

TEST(Grip, TheCasterTakesItsShareOfTheLoad) {
  EXPECT_NEAR(axle_load_share({}), 1.0 - 0.27 / 1.3, 1e-4);
  const TyreLoads rest = tyre_loads({}, kGravity, {});
  EXPECT_NEAR(rest.pressing_N[0] + rest.pressing_N[1], 0.7923 * 3.41275 * kGravity, 1e-3);
  EXPECT_EQ(rest.pressing_N[0], rest.pressing_N[1]);
  VehicleConfig above_axle;
  above_axle.payload_kg = 1e4;
  above_axle.payload_x_m = above_axle.axle_x_m;
  EXPECT_NEAR(axle_load_share(above_axle), 1.0, 1e-4);
}

TEST(Grip, RigidTyresHoldTheFrictionOfTheirShare) {
  EXPECT_NEAR(lateral_grip_mps2({}, 0.6, kGravity, 0.0), 0.7923 * 0.6 * kGravity, 1e-3);
  EXPECT_NEAR(needed_friction({}, kGravity, {4.0, 1.0, 0.0}), 4.0 / (0.7923 * kGravity), 1e-4);
}

TEST(Grip, CirclesHoldLessThanThePyramid) {
  const VehicleConfig v = brush();
  for (const double omega : {0.0, 0.5, 1.0, 2.0}) {
    EXPECT_LT(lateral_grip_mps2(v, 0.6, kGravity, omega),
              lateral_grip_mps2({}, 0.6, kGravity, omega));
  }
  // The held load is at the limit of both.
  const double grip = lateral_grip_mps2(v, 0.6, kGravity, 1.0);
  const TyreLoads t = tyre_loads(v, kGravity, {grip, 1.0, 0.0});
  double holds_N = 0.0;
  for (const int side : {0, 1}) {
    holds_N += std::sqrt(std::pow(0.6 * t.pressing_N[side], 2) - std::pow(t.along_N[side], 2));
  }
  EXPECT_NEAR(holds_N, t.across_N, 1e-6);
}

TEST(Grip, IsTheSameToBothSidesAndLessOnTheLoadedOne) {
  VehicleConfig v = brush();
  EXPECT_DOUBLE_EQ(needed_friction(v, kGravity, {1.0, 2.0, 0.3}),
                   needed_friction(v, kGravity, {1.0, -2.0, 0.3}));
  v.payload_kg = 2.0;
  v.payload_y_m = 0.3;  // on the left; a left turn presses the right
  EXPECT_LT(needed_friction(v, kGravity, {2.0, 1.5, 0.0}),
            needed_friction(v, kGravity, {2.0, -1.5, 0.0}));
}

TEST(Grip, AVehicleThatLiftsOffNeedsMoreThanFriction) {
  // The nose: m g d = (m h + m_w r) a, at 5.28 m/s².
  EXPECT_LT(needed_friction(brush(), kGravity, {1.0, 0.0, 5.2}), 1.0);
  EXPECT_EQ(needed_friction(brush(), kGravity, {1.0, 0.0, 5.4}),
            std::numeric_limits<double>::infinity());
  EXPECT_EQ(needed_friction({}, kGravity, {20.0, 1.0, 0.0}),
            std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace tether
