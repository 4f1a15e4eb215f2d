// The brush tyre alone, against its closed form.

#include <gtest/gtest.h>

#include <cmath>

#include "sim/plant/ode_world.hpp"

namespace tether {
namespace {

constexpr double kTyreStep_s = 1e-3;
constexpr double kPressing_N = 500.0;
constexpr BrushTyre::Config kTyre{.stiffness = 20.0, .relaxation_m = 0.02, .friction = 0.6};

/// The force of a tyre that is dragged over the floor at `slip_mps` for `seconds`.
BrushTyre::Vector drag(BrushTyre& tyre, const BrushTyre::Vector& slip_mps, double rolling_mps,
                       double seconds, double step_s = kTyreStep_s) {
  BrushTyre::Vector force_N{};
  for (double t_s = 0.0; t_s < seconds; t_s += step_s) {
    const BrushTyre::Row row = tyre.prepare(slip_mps, rolling_mps, kPressing_N, step_s);
    for (const int i : {0, 1}) force_N[i] = (row.bias_mps[i] - slip_mps[i]) / row.softness_mps_N;
    tyre.finish(force_N);
  }
  return force_N;
}

TEST(BrushTyre, ForceBeginsWithTheStiffnessAndEndsAtTheFriction) {
  const double tiny = 1e-6;
  EXPECT_NEAR(BrushTyre::steady_force(kTyre, tiny, kPressing_N) / tiny, 20.0 * kPressing_N, 1.0);
  const double sliding = BrushTyre::sliding_slip(kTyre);
  EXPECT_DOUBLE_EQ(sliding, 3.0 * 0.6 / 20.0);
  EXPECT_DOUBLE_EQ(BrushTyre::steady_force(kTyre, sliding, kPressing_N), 0.6 * kPressing_N);
  EXPECT_DOUBLE_EQ(BrushTyre::steady_force(kTyre, 10.0, kPressing_N), 0.6 * kPressing_N);
  // Half way to sliding: 1 - (1 - 1/2)³ of the friction.
  EXPECT_DOUBLE_EQ(BrushTyre::steady_force(kTyre, 0.5 * sliding, kPressing_N),
                   0.875 * 0.6 * kPressing_N);
}

TEST(BrushTyre, RollingSteadilyFollowsTheSlipCurve) {
  for (const double slip : {0.001, 0.01, 0.03, 0.06, 0.2}) {
    for (const double rolling_mps : {0.05, 1.0, -2.0, 8.0}) {
      BrushTyre tyre(kTyre);
      const double slip_mps = slip * std::abs(rolling_mps);
      // Ten relaxation lengths.
      const BrushTyre::Vector f =
          drag(tyre, {slip_mps, 0.0}, rolling_mps, 0.2 / std::abs(rolling_mps) + 0.1);
      const double expected_N = BrushTyre::steady_force(kTyre, slip, kPressing_N);
      // A tyre that slides is limited only as precisely as a step's slip is of the stretch.
      EXPECT_NEAR(-f[0], expected_N, 0.002 * expected_N) << slip << " at " << rolling_mps;
      EXPECT_EQ(f[1], 0.0);
    }
  }
}

TEST(BrushTyre, BothDirectionsShareOneLimit) {
  for (const double angle : {0.0, 0.4, 0.8, 1.6, 3.0}) {
    BrushTyre tyre(kTyre);
    const BrushTyre::Vector f = drag(tyre, {std::cos(angle), std::sin(angle)}, 2.0, 1.0);
    EXPECT_NEAR(std::hypot(f[0], f[1]), 0.6 * kPressing_N, 1e-9 * kPressing_N);
    EXPECT_NEAR(f[0], -0.6 * kPressing_N * std::cos(angle), 1e-6);
    EXPECT_NEAR(f[1], -0.6 * kPressing_N * std::sin(angle), 1e-6);
  }
}

TEST(BrushTyre, AtRestItIsASpringThatHolds) {
  BrushTyre tyre(kTyre);
  drag(tyre, {0.01, 0.0}, 0.0, 0.1);  // 1 mm
  const BrushTyre::Vector f = drag(tyre, {0.0, 0.0}, 0.0, 10.0);
  EXPECT_NEAR(tyre.deflection_m()[0], 1e-3, 2e-5);
  const double slip = tyre.deflection_m()[0] / kTyre.relaxation_m;
  EXPECT_NEAR(-f[0], BrushTyre::steady_force(kTyre, slip, kPressing_N), 1e-3);
}

TEST(BrushTyre, ForceBuildsUpOverTheRelaxationLength) {
  BrushTyre tyre(kTyre);
  const double rolling_mps = 0.5;
  // One relaxation length: 1 - 1/e of a small force. The loss adds the rate, 5 ms of 40 ms.
  const BrushTyre::Vector f =
      drag(tyre, {1e-5, 0.0}, rolling_mps, kTyre.relaxation_m / rolling_mps, 1e-5);
  const double share = -f[0] / BrushTyre::steady_force(kTyre, 2e-5, kPressing_N);
  EXPECT_NEAR(share, 1.0 - std::exp(-1.0) * (1.0 - 5e-3 / 40e-3), 0.002);
}

TEST(BrushTyre, WithoutFrictionOrLoadThereIsNoForce) {
  BrushTyre::Config ice = kTyre;
  ice.friction = 0.0;
  EXPECT_EQ(BrushTyre(ice).prepare({1.0, 0.0}, 1.0, kPressing_N, kTyreStep_s).softness_mps_N, 0.0);
  EXPECT_EQ(BrushTyre(kTyre).prepare({1.0, 0.0}, 1.0, 0.0, kTyreStep_s).softness_mps_N, 0.0);
}

}  // namespace
}  // namespace tether
