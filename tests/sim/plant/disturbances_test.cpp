#include "sim/plant/disturbances.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "sim/plant/plant.hpp"

namespace tether {
namespace {

constexpr double kDisturbedStep_s = 1e-3;

/// The state after `seconds` with both rims told this speed.
VehicleState driven(const VehicleSettings& vehicle, const WorldSettings& world, double rim_mps,
                    double seconds, std::uint64_t seed = 1) {
  const auto plant = make_plant(vehicle, world, from_seconds(kDisturbedStep_s), seed);
  plant->set_wheel_targets({rim_mps, rim_mps});
  for (int i = 0; i < static_cast<int>(seconds / kDisturbedStep_s); ++i) plant->step();
  return plant->state();
}

// ------------------------------------------------------------------------------------- slope

TEST(Slope, AFloorWithoutFrictionLetsTheVehicleSlideAsOnAnInclinedPlane) {
  WorldSettings world;
  world.friction = 0.0;
  world.slope_x = 0.1;
  world.slope_y = -0.05;
  const VehicleState s = driven({}, world, 0.0, 1.0);
  const double share = 9.81 / std::sqrt(1.0 + 0.01 + 0.0025);
  // The steps add up to ½ g t (t + step).
  EXPECT_NEAR(s.pose.x_m, -0.5 * share * 0.1 * 1.001, 1e-3);
  EXPECT_NEAR(s.pose.y_m, 0.5 * share * 0.05 * 1.001, 1e-3);
}

TEST(Slope, TyresHoldTheVehicleWhereTheyGrip) {
  WorldSettings world;
  world.slope_x = 0.1;
  world.slope_y = -0.05;
  const VehicleState s = driven({}, world, 0.0, 5.0);
  EXPECT_NEAR(std::hypot(s.pose.x_m, s.pose.y_m), 0.0, 1e-3);
}

// -------------------------------------------------------------------------------------- drag

TEST(Drag, ThatTheServoCanOvercomeChangesNothing) {
  VehicleSettings vehicle;
  vehicle.left_drag_N = 3.0;  // part of the 10 N that 4 N m make at a rim of 0.4 m
  const VehicleState s = driven(vehicle, {}, 1.0, 4.0);
  EXPECT_NEAR(s.rim_speeds.left_mps, 1.0, 1e-3);
  EXPECT_NEAR(s.pose.yaw_rad, 0.0, 0.01);
}

TEST(Drag, BeyondTheServosTorqueTurnsTheVehicleToItsSide) {
  VehicleSettings left, right;
  left.left_drag_N = 15.0;
  right.right_drag_N = 15.0;
  const VehicleState turned_left = driven(left, {}, 1.0, 4.0);
  const VehicleState turned_right = driven(right, {}, 1.0, 4.0);
  EXPECT_GT(turned_left.pose.yaw_rad, 0.1);
  EXPECT_NEAR(turned_right.pose.yaw_rad, -turned_left.pose.yaw_rad, 1e-6);
  EXPECT_LT(turned_left.rim_speeds.left_mps, 0.9);
}

TEST(Drag, DoesNotTurnAWheelBack) {
  VehicleSettings vehicle;
  vehicle.left_drag_N = vehicle.right_drag_N = 1000.0;
  const VehicleState s = driven(vehicle, {}, 1.0, 2.0);
  EXPECT_GE(s.pose.x_m, 0.0);
  EXPECT_LT(s.pose.x_m, 0.1);
}

// ------------------------------------------------------------------------------------- bumps

WorldSettings bumpy(double spacing_m) {
  WorldSettings world;
  world.bump_spacing_m = spacing_m;
  return world;
}

TEST(Bumps, GiveTheMomentumOfTheirSlopeAndTakeBackWhatTheyHeldBack) {
  WorldSettings world = bumpy(1.0);
  constexpr double kMass_kg = 2.0, kSpeed_mps = 1.5;
  constexpr double kShort_s = 1e-5;
  Bumps bumps(world, kMass_kg, RandomEngine(1));
  bool met = false;
  double up_Ns = 0.0, forward_Ns = 0.0;
  for (int i = 0; i < 10'000'000; ++i) {
    const WheelLoad load = bumps.step(kSpeed_mps, kShort_s);
    if (load.up_N == 0.0 && met) break;
    met = met || load.up_N != 0.0;
    up_Ns += load.up_N * kShort_s;
    forward_Ns += load.forward_N * kShort_s;
  }
  const double slope = std::numbers::pi * world.bump_height_m / world.bump_length_m;
  EXPECT_NEAR(up_Ns, kMass_kg * kSpeed_mps * slope, 1e-3);
  EXPECT_NEAR(forward_Ns, 0.0, 1e-3);
}

TEST(Bumps, AreAsFarApartAsTheSpacingOnAverage) {
  Bumps bumps(bumpy(1.0), 2.0, RandomEngine(1));
  constexpr double kWay_m = 10'000.0;
  int met = 0;
  bool before = false;
  for (int i = 0; i < static_cast<int>(kWay_m / 0.01); ++i) {
    const bool now = bumps.step(1.0, 0.01).forward_N != 0.0;
    if (now && !before) ++met;
    before = now;
  }
  // A renewal process of mean μ = 1.2 m and deviation σ = 1 m has n/μ ± σ √(n/μ³). Ways of less
  // than the 1 cm that is looked at, 1 in 100, join two bumps.
  const double expected = kWay_m / 1.2;
  EXPECT_NEAR(met, expected * 0.995, 4.0 * std::sqrt(kWay_m / std::pow(1.2, 3)));
}

TEST(Bumps, AreWhereTheyAreWhateverTheSpeed) {
  Bumps slow(bumpy(1.0), 2.0, RandomEngine(3)), fast(bumpy(1.0), 2.0, RandomEngine(3));
  for (int i = 0; i < 2000; ++i) {
    const bool on_slow = slow.step(0.5, 0.02).forward_N != 0.0;
    const bool on_fast = fast.step(2.0, 0.005).forward_N != 0.0;
    EXPECT_EQ(on_slow, on_fast);
  }
}

TEST(Bumps, MoveTheVehicleReproduciblyAndDifferentlyWithAnotherSeed) {
  const VehicleState once = driven({}, bumpy(0.5), 2.0, 3.0, 1);
  const VehicleState again = driven({}, bumpy(0.5), 2.0, 3.0, 1);
  const VehicleState other = driven({}, bumpy(0.5), 2.0, 3.0, 2);
  EXPECT_EQ(once.pose.y_m, again.pose.y_m);
  EXPECT_NE(once.pose.y_m, other.pose.y_m);
  EXPECT_EQ(driven({}, {}, 2.0, 3.0, 1).pose.y_m, driven({}, {}, 2.0, 3.0, 2).pose.y_m);
}

}  // namespace
}  // namespace tether
