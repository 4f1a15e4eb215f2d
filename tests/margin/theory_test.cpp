#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/KroneckerProduct>

#include "tools/margin/mean_square.hpp"
#include "tools/margin/sampled_loop.hpp"
#include "tools/margin/verification.hpp"

namespace tether {
namespace {

Eigen::MatrixXd matrix(double a, double b, double c, double d) {
  Eigen::MatrixXd m(2, 2);
  m << a, b, c, d;
  return m;
}

LoopStep straight(double v_mps, double h_s, double delay_s = 0.0, double noise = 0.0) {
  const PathMotion motion{v_mps, 0.0};
  return sampled_step({motion, motion, motion, tracking_jacobian(2.5, 0.8, 2.0, v_mps)},
                      {h_s, delay_s, 0.0}, {noise, noise});
}

/// Losses each way, independent, a command for each pose that arrives.
LossChain independent(double prr) {
  return both_links(ChainLink::independent(prr), ChainLink::independent(prr));
}

double critical_prr(double v_mps, double h_s) {
  const LoopStep steering = part_of(straight(v_mps, h_s), LoopPart::across);
  const Critical found =
      critical_value([&](double prr) { return mean_square_radius(independent(prr), {steering}); },
                     0.01, 1.0, 1e-6);
  return found.kind == Critical::Kind::found ? found.value : NAN;
}

TEST(MeanSquareTest, TwoStableModesCanBeUnstableTogether) {
  const Matrix p{{0.5, 0.5}, {0.5, 0.5}};
  EXPECT_NEAR(mean_square_radius(p, {matrix(0, 2, 0, 0.5), matrix(0.5, 0, 2, 0)}), 2.125, 1e-7);
}

TEST(MeanSquareTest, TwoUnstableModesCanBeStableTogether) {
  const Matrix p{{0.1, 0.9}, {0.9, 0.1}};
  EXPECT_NEAR(mean_square_radius(p, {matrix(2, -1, 0, 0), matrix(0, 1, 0, 2)}), 0.4, 1e-7);
}

TEST(MeanSquareTest, AScalarThatIsResetOnReceptionGrowsByASquaredTimesTheLoss) {
  LoopStep step;
  step.a = {Eigen::MatrixXd::Zero(1, 1), Eigen::MatrixXd::Constant(1, 1, 1.7)};
  for (const double prr : {0.3, 0.6, 0.654, 0.9}) {
    const LossChain chain = both_links(ChainLink::independent(prr), ChainLink::independent(1.0));
    EXPECT_NEAR(mean_square_radius(chain, {step}), 1.7 * 1.7 * (1.0 - prr), 1e-7) << prr;
  }
}

/// The matrix of the theorem, with all its rows.
TEST(MeanSquareTest, IsTheRadiusOfTheKroneckerMatrixWithBurstsOnBothLinks) {
  const LossChain chain = both_links(ChainLink::bursts(0.7, 3.0), ChainLink::bursts(0.8, 2.0));
  const LoopStep step = part_of(straight(2.0, 0.1, 0.03), LoopPart::all);
  const Eigen::Index n = step.a[0].rows(), nn = n * n;
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(4 * nn, 4 * nn);
  for (const auto& jump : chain.jumps) {
    whole.block(static_cast<Eigen::Index>(jump.to) * nn, static_cast<Eigen::Index>(jump.from) * nn,
                nn, nn) +=
        jump.probability * Eigen::kroneckerProduct(step.a[jump.mode], step.a[jump.mode]).eval();
  }
  const double radius = whole.eigenvalues().cwiseAbs().maxCoeff();
  EXPECT_NEAR(mean_square_radius(chain, {step}), radius, 1e-6);
}

TEST(MeanSquareTest, TwoEqualStepsInTurnGrowAsOne) {
  const LoopStep step = part_of(straight(2.87, 0.05), LoopPart::all);
  const LossChain chain = independent(0.5);
  EXPECT_NEAR(mean_square_radius(chain, {step, step}), mean_square_radius(chain, {step}), 1e-6);
}

/// Analytically: x⁺ = 0.9 x + noise on reception, else x⁺ = x.
TEST(StationaryMomentsTest, AScalarHasItsClosedForm) {
  LoopStep step;
  step.a = {matrix(0.9, 0, 0, 1), matrix(1, 0, 0, 1)};
  step.noise = {matrix(0.04, 0, 0, 0), matrix(0, 0, 0, 0)};
  const auto moments = stationary_moments(
      both_links(ChainLink::independent(0.5), ChainLink::independent(1.0)), {step});
  ASSERT_TRUE(moments);
  EXPECT_NEAR(moments->front()(0, 0), 0.04 / (1.0 - 0.81), 1e-7);
}

/// Analytically: ln λ = p ln a + (1 − p) ln b. 90 000 draws have a standard deviation of |ln(a/b)|
/// √(p (1 − p)/90 000) = 0.0027; allowed are four.
TEST(AlmostSureTest, AScalarGrowsByTheGeometricMeanAndItsSquareByThatOfSquares) {
  LoopStep step;
  step.a = {Eigen::MatrixXd::Constant(1, 1, 0.5), Eigen::MatrixXd::Constant(1, 1, 3.0)};
  const LossChain chain = both_links(ChainLink::independent(0.7), ChainLink::independent(1.0));
  const double log_growth = 0.7 * std::log(0.5) + 0.3 * std::log(3.0);
  EXPECT_NEAR(std::log(almost_sure_growth(chain, {step})), log_growth, 0.011);
  EXPECT_LT(log_growth, 0.0);
  EXPECT_GT(mean_square_radius(chain, {step}), 1.0);  // vanishes, and has no mean square
}

/// Rotations in between change which direction grows: a product whose growth is no eigenvalue's.
/// Without losses it is the spectral radius.
TEST(AlmostSureTest, WithoutLossesIsTheSpectralRadius) {
  const LoopStep step = part_of(straight(2.0, 0.1, 0.03), LoopPart::across);
  EXPECT_NEAR(almost_sure_growth(independent(1.0), {step}),
              step.a[LossChain::kReceived].eigenvalues().cwiseAbs().maxCoeff(), 1e-3);
}

TEST(AlmostSureTest, IsNoStrongerThanTheMeanSquare) {
  const LoopStep steering = part_of(straight(2.87, 0.05), LoopPart::across);
  for (const double prr : {0.2, 0.4, 0.5, 0.6, 0.8}) {
    const double almost = almost_sure_growth(independent(prr), {steering});
    EXPECT_LE(almost * almost, mean_square_radius(independent(prr), {steering}) + 1e-3) << prr;
  }
}

/// ẋ = u + v with noise of intensity 1, sampled every second; u = −k x (JitterTime's first example:
/// Cervin, Pazzaglia, Barzegaran, Mahfouzi, 2019), right after a sample. Lost: u = 0, or held.
LoopStep integrator(bool holds) {
  const double k = (3.0 + std::sqrt(3.0)) / (2.0 + std::sqrt(3.0));
  Eigen::MatrixXd received(3, 3), lost(3, 3);
  received << 1, 1, 0, -k, -k, 0, 0, 0, 1;
  lost << 1, 1, 0, 0, holds ? 1 : 0, 0, 0, 0, 1;
  const Eigen::Vector3d answered(1, -k, 0), unheard(1, 0, 0);
  LoopStep step;
  step.a = {received, lost};
  step.noise = {answered * answered.transpose(), unheard * unheard.transpose()};
  step.is_along = {false, false, false};
  return step;
}

LossChain downlink_alone(double prr) {
  return both_links(ChainLink::independent(1.0), ChainLink::independent(prr));
}

// Values as printed by JitterTime.jl.
TEST(StationaryMomentsTest, OfASampledIntegratorAreJitterTimes) {
  const auto moments = stationary_moments(downlink_alone(1.0), {integrator(false)});
  ASSERT_TRUE(moments);
  EXPECT_NEAR(moments->front()(0, 0), 1.077350269189626, 1e-8);
  EXPECT_NEAR(moments->front()(0, 1), -1.366025403784438, 1e-8);
  EXPECT_NEAR(moments->front()(1, 1), 1.732050807568876, 1e-8);
}

// Analytically: P_xx = 1/(p (1 − (1 − k)²)), growth p (1 − k)² + 1 − p.
TEST(StationaryMomentsTest, OfASampledIntegratorThatRestsWhenCommandsAreLostHaveTheirClosedForm) {
  const auto moments = stationary_moments(downlink_alone(0.5), {integrator(false)});
  ASSERT_TRUE(moments);
  EXPECT_NEAR(moments->front()(0, 0), 2.0 * 1.077350269189626, 1e-7);
  const LoopStep rests = part_of(integrator(false), LoopPart::all);
  const double k = (3.0 + std::sqrt(3.0)) / (2.0 + std::sqrt(3.0));
  EXPECT_NEAR(mean_square_radius(downlink_alone(0.7), {rests}), 0.7 * (1 - k) * (1 - k) + 0.3,
              1e-7);
}

// Holding a lost command's predecessor is worse than resting: unstable at 0.7.
TEST(MeanSquareTest, ASampledIntegratorThatHoldsItsCommandIsUnstableAtAReceptionOf70Percent) {
  const LoopStep holds = part_of(integrator(true), LoopPart::all);
  EXPECT_NEAR(mean_square_radius(downlink_alone(0.9), {holds}), 0.6424, 5e-5);
  EXPECT_NEAR(mean_square_radius(downlink_alone(0.7), {holds}), 1.1700, 5e-5);
}

TEST(StationaryMomentsTest, AnUnstableLoopHasNone) {
  EXPECT_FALSE(stationary_moments(independent(0.3), {straight(2.87, 0.05, 0.0, 0.01)}));
  EXPECT_TRUE(stationary_moments(independent(0.7), {straight(2.87, 0.05, 0.0, 0.01)}));
}

TEST(SampledLoopTest, SteeringOnAStraightIsTheTextbooksHold) {
  const double v = 2.0, h = 0.1;
  const LoopStep step = part_of(straight(v, h), LoopPart::across);  // y_e, θ_e, ω in force
  Eigen::MatrixXd lost(3, 3), received(3, 3);
  lost << 1, v * h, -0.5 * v * h * h, 0, 1, -h, 0, 0, 1;
  received << 1 - 0.5 * v * h * h * v * 0.8, v * h - 0.5 * v * h * h * v * 2.0, 0, -h * v * 0.8,
      1 - h * v * 2.0, 0, v * 0.8, v * 2.0, 0;
  EXPECT_TRUE(step.a[LossChain::kLost].isApprox(lost, 1e-12)) << step.a[LossChain::kLost];
  EXPECT_TRUE(step.a[LossChain::kReceived].isApprox(received, 1e-12));
}

TEST(SampledLoopTest, WithoutLossesTheDelayMarginIsTheFormulasLessHalfAHold) {
  const double h = 0.05;
  const Critical delay = critical_value(
      [&](double d_s) {
        return mean_square_radius(independent(1.0),
                                  {part_of(straight(2.87, h, d_s), LoopPart::across)});
      },
      0.0, 0.4, 1e-4);
  ASSERT_EQ(delay.kind, Critical::Kind::found);
  EXPECT_NEAR(delay.value, SteeringLoop{.v_mps = 2.87}.delay_margin_s() - 0.5 * h, 0.004);
}

// Where silences are short the general operator finds it, too.
TEST(PlannedLoopTest, HasTheRadiusOfItsMatrices) {
  const PlannedPeriod period{{2.0, 0.0}, tracking_jacobian(2.5, 0.8, 2.0, 2.0), 0.05, 2};
  const LossChain chain = independent(0.9);
  for (const LoopPart part : {LoopPart::across, LoopPart::along}) {
    EXPECT_NEAR(planned_radius(chain, period, part),
                mean_square_radius(chain, {part_of(planned_step(period, {}), part)}), 1e-6);
  }
  EXPECT_NEAR(planned_radius(independent(0.3), period, LoopPart::across), 1.0 - 0.3 * 0.3, 1e-6);
}

TEST(CriticalPrrTest, IsThatOfThePublishedTable) {
  EXPECT_NEAR(critical_prr(1.0, 0.05), 0.336, 5e-4);
  EXPECT_NEAR(critical_prr(2.0, 0.05), 0.462, 5e-4);
  EXPECT_NEAR(critical_prr(2.87, 0.05), 0.541, 5e-4);
  EXPECT_NEAR(critical_prr(1.0, 0.1), 0.462, 5e-4);
  EXPECT_NEAR(critical_prr(2.0, 0.1), 0.620, 5e-4);
  EXPECT_NEAR(critical_prr(2.87, 0.1), 0.711, 5e-4);
  EXPECT_NEAR(critical_prr(1.0, 0.5), 0.853, 5e-4);
  EXPECT_GT(critical_prr(2.0, 0.5), 0.9999);  // an eigenvalue of exactly -1 without any loss
  EXPECT_TRUE(std::isnan(critical_prr(2.87, 0.5)));
}

/// The interval is of ten seeds; the bias of a thousand loops is far below.
TEST(CriticalPrrTest, AtItSimulatedLoopsNeitherGrowNorShrink) {
  const LoopStep steering = part_of(straight(2.87, 0.05), LoopPart::across);
  const LossChain chain = independent(critical_prr(2.87, 0.05));
  double sum = 0.0, squares = 0.0;
  for (int seed = 1; seed <= 10; ++seed) {
    const double radius =
        simulated_radius(chain, {steering},
                         {.loops = 500, .periods = 600, .seed = static_cast<std::uint64_t>(seed)});
    sum += radius;
    squares += radius * radius;
  }
  const double mean = sum / 10.0, deviation = std::sqrt((squares / 10.0 - mean * mean) / 9.0);
  EXPECT_NEAR(mean, 1.0, 4.0 * deviation);
  EXPECT_LT(deviation, 0.005);
}

TEST(DelayMarginTest, IsThatOfTheFormula) {
  EXPECT_NEAR(SteeringLoop{.v_mps = 2.87}.delay_margin_s(), 0.235, 5e-4);
  EXPECT_NEAR(SteeringLoop{.v_mps = 2.0}.delay_margin_s(), 0.338, 5e-4);
}

TEST(DelayMarginTest, DelaysThatVaryHaveLessRoomThanConstantOnes) {
  for (const double v : {0.5, 1.0, 2.87}) {
    const SteeringLoop loop{.v_mps = v};
    EXPECT_LT(loop.varying_delay_margin_s(), loop.delay_margin_s());
    EXPECT_GT(loop.varying_delay_margin_s(), 0.5 * loop.delay_margin_s());
  }
}

TEST(CriticalValueTest, SaysWhereThereIsNone) {
  using Kind = Critical::Kind;
  EXPECT_EQ(critical_value([](double) { return 0.5; }, 0, 1, 1e-3).kind, Kind::always);
  EXPECT_EQ(critical_value([](double) { return 1.5; }, 0, 1, 1e-3).kind, Kind::never);
  const auto wave = [](double x) { return 1.0 + 0.5 * std::sin(12.0 * x + 0.1); };
  EXPECT_EQ(critical_value(wave, 0, 1, 1e-3).kind, Kind::not_monotone);
}

TEST(LossChainTest, BurstsOnTheDownlinkGoOnOnlyWithTheCommandsThatItIsOffered) {
  const LossChain chain = both_links(ChainLink::independent(0.5), ChainLink::bursts(0.7, 4.0));
  EXPECT_NEAR(chain.prr(), 0.35, 1e-12);
  double stays_bad = 0.0;  // half of the periods offer it nothing
  for (const auto& jump : chain.jumps) {
    if (jump.from == 1 && jump.to == 1) stays_bad += jump.probability;
  }
  EXPECT_NEAR(stays_bad, 0.5 + 0.5 * 0.75, 1e-12);
}

}  // namespace
}  // namespace tether
