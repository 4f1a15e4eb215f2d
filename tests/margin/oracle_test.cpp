#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <optional>

#include "tools/margin/intersample.hpp"
#include "tools/margin/mean_square.hpp"

// Values of other people's programs for sampled loops: the tests of JitterTime.jl (commit 20d58bf;
// Cervin and others, MIT), the example "multirate" of Jitterbug's manual, and jitter that
// stabilises, after Kushner and Tobias (IEEE Trans. Autom. Control 14 (2), 1969).

namespace tether {
namespace {

using Eigen::MatrixXd;

/// Second moments of the state, and the cost so far.
struct Moments {
  MatrixXd p;
  double cost = 0.0;

  /// Returns the mean cost during it.
  double pass(const EventInterval& interval, double h_s) {
    const double of_interval = (interval.cost * p).trace() + interval.noise_cost;
    p = interval.phi * p * interval.phi.transpose() + interval.noise;
    cost += of_interval;
    return of_interval / h_s;
  }
  void event(const MatrixXd& jump) { p = jump * p * jump.transpose(); }
  void event(const MatrixXd& jump, const MatrixXd& noise) {
    event(jump);
    p += noise;
  }
};

MatrixXd rows(int n, const std::vector<double>& values) {
  return Eigen::Map<const Eigen::Matrix<double, -1, -1, Eigen::RowMajor>>(
      values.data(), n, static_cast<Eigen::Index>(values.size()) / n);
}
MatrixXd diagonal(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size()))
      .asDiagonal();
}

const double kGain = (3.0 + std::sqrt(3.0)) / (2.0 + std::sqrt(3.0));

/// ẋ = u + v of one integrator; the state is x, the sample s and u = −k s.
struct IntegratorLoop {
  explicit IntegratorLoop(double weight_of_u)
      : step(between_events(rows(3, {0, 0, 1, 0, 0, 0, 0, 0, 0}), diagonal({1, 0, 0}),
                            diagonal({1, 0, weight_of_u}), 0.1)) {}

  /// The mean cost in the last tenth.
  double period() {
    double last = 0.0;
    for (int i = 0; i < 10; ++i) last = moments.pass(step, 0.1);
    return last;
  }
  void actuate() { moments.event(rows(3, {1, 0, 0, 0, 1, 0, 0, -kGain, 0})); }
  void sample() { moments.event(rows(3, {1, 0, 0, 1, 0, 0, 0, 0, 1})); }
  void sample_zero() { moments.event(diagonal({1, 0, 1})); }

  EventInterval step;
  Moments moments{MatrixXd::Zero(3, 3)};
};

TEST(JitterTimeOracle, OneIntegratorThatIsControlledFromItsThirdPeriodOn) {
  IntegratorLoop loop(0.0);
  double last = 0.0;
  for (int period = 1; period <= 6; ++period) {
    last = loop.period();
    if (period < 3) continue;
    loop.sample();
    loop.actuate();
  }
  EXPECT_NEAR(loop.moments.cost, 7.420841162336913, 1e-12);
  EXPECT_NEAR(last, 0.996949192568094, 1e-12);
  EXPECT_NEAR(loop.moments.p(0, 0), 1.078061834694495, 1e-12);
  EXPECT_NEAR(loop.moments.p(0, 2), -1.366927632691700, 1e-12);
  EXPECT_NEAR(loop.moments.p(2, 2), 1.733194787983227, 1e-12);
}

TEST(JitterTimeOracle, ASamplerWithTwoVersions) {
  IntegratorLoop loop(1.0);
  double last = 0.0;
  for (int period = 1; period <= 6; ++period) {
    last = loop.period();
    if (period < 3) continue;
    period == 3 ? loop.sample() : loop.sample_zero();
    loop.actuate();
  }
  EXPECT_NEAR(loop.moments.cost, 15.057713659400530, 1e-11);
  EXPECT_NEAR(last, 3.165390309173476, 1e-12);
  EXPECT_NEAR(loop.moments.p(0, 0), 3.215390309173475, 1e-12);
}

/// The loss chain of a loop without losses.
LossChain no_losses() {
  return both_links(ChainLink::independent(1.0), ChainLink::independent(1.0));
}

/// `event` at the beginning of a period, 1 as the last component.
LoopStep step_of(const EventInterval& interval, const MatrixXd& event) {
  const Eigen::Index n = event.rows();
  LoopStep step;
  for (const std::size_t mode : {LossChain::kReceived, LossChain::kLost}) {
    step.a[mode] = MatrixXd::Identity(n + 1, n + 1);
    step.a[mode].topLeftCorner(n, n) = interval.phi * event;
    step.noise[mode] = MatrixXd::Zero(n + 1, n + 1);
    step.noise[mode].topLeftCorner(n, n) = interval.noise;
  }
  return step;
}

/// The mean cost of events that repeat, each followed by `interval`, which lasts `h_s`.
double mean_cost(const std::vector<MatrixXd>& events, const EventInterval& interval, double h_s) {
  std::vector<LoopStep> steps;
  for (const MatrixXd& event : events) steps.push_back(step_of(interval, event));
  const auto moments = stationary_moments(no_losses(), steps);
  if (!moments) return NAN;
  double sum = 0.0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Eigen::Index n = events[i].rows();
    const MatrixXd p = events[i] * (*moments)[i].topLeftCorner(n, n) * events[i].transpose();
    sum += (interval.cost * p).trace() + interval.noise_cost;
  }
  return sum / (h_s * static_cast<double>(events.size()));
}

// Its moments: theory_test.cpp.
TEST(JitterTimeOracle, TheCostOfAnIntegratorThatIsControlledEveryPeriod) {
  const EventInterval period =
      between_events(rows(2, {0, 1, 0, 0}), diagonal({1, 0}), diagonal({1, 0}), 1.0);
  EXPECT_NEAR(mean_cost({rows(2, {1, 0, -kGain, 0})}, period, 1.0), (3.0 + std::sqrt(3.0)) / 6.0,
              1e-8);
}

TEST(JitterTimeOracle, TwoSensorsWithPeriodsOfTheirOwnAndAnObserver) {
  // x₁, x₂, the observer's two, u.
  MatrixXd a = MatrixXd::Zero(5, 5), r = a;
  a(0, 1) = a(1, 0) = a(1, 4) = 1.0;
  r(1, 1) = 1.0;
  const EventInterval step = between_events(a, r, diagonal({1, 0.1, 0, 0, 0.1}), 0.005);
  MatrixXd second = MatrixXd::Identity(5, 5);  // s₂
  second.block(2, 1, 2, 1) = rows(2, {0.3906, 0.9837});
  second.block(2, 2, 2, 2) = rows(2, {1, -0.3906, 0, 0.0163});
  const MatrixXd gain_2 = rows(5, {0, 0, 0.3906, 0.9837, 0});
  MatrixXd first = MatrixXd::Identity(5, 5);  // s₁
  const MatrixXd keep = rows(2, {0.5309, 0.079, -0.8673, 0.8597});
  first.block(2, 0, 2, 1) = rows(2, {0.4750, 1.0065});
  first.block(2, 2, 2, 2) = keep;
  first.block(2, 4, 2, 1) = rows(2, {0.0059, 0.1392});
  MatrixXd actuate = MatrixXd::Identity(5, 5);
  actuate.row(4) << 0, 0, -3.633, -2.7434, 0;
  const MatrixXd gain_1 = actuate * rows(5, {0, 0, 0.4750, 1.0065, 0});
  first = actuate * first;

  Moments moments{MatrixXd::Zero(5, 5)};
  double last = 0.0;
  for (int block = 1; block <= 240; ++block) {
    for (int i = 0; i < 10; ++i) last = moments.pass(step, 0.005);
    if (block % 10 == 0) moments.event(second, 0.01 * gain_2 * gain_2.transpose());
    if (block % 3 == 0) moments.event(first, 0.1 * gain_1 * gain_1.transpose());
  }
  EXPECT_NEAR(moments.cost, 12.574852494566098, 1e-10);
  EXPECT_NEAR(last, 0.860680772466343, 1e-10);
  EXPECT_NEAR(moments.p(0, 0), 0.334482211088805, 1e-10);
  EXPECT_NEAR(moments.p(1, 1), 0.736398452636592, 1e-10);
  EXPECT_NEAR(moments.p(4, 4), 11.222643465877262, 1e-10);
}

TEST(JitterTimeOracle, AContinuousLoop) {
  const MatrixXd a = rows(3, {-1, 1, 0, 0, -1, -1, 1, 0, 0});
  const EventInterval second =
      between_events(a, diagonal({0, 1, 1}), MatrixXd::Identity(3, 3), 1.0);
  Moments moments{MatrixXd::Zero(3, 3)};
  for (int i = 0; i < 1000; ++i) moments.pass(second, 1.0);
  EXPECT_NEAR(moments.cost, 7470.0, 1e-6);
  const MatrixXd expected = rows(3, {1.5, 1.5, -0.5, 1.5, 2.5, -2, -0.5, -2, 3.5});
  EXPECT_LT((moments.p - expected).norm(), 1e-10);
}

/// Jitterbug's ball and beam, φ̇ = 4.4 (u + v), ẍ = −9 φ: r = PID(x), u = 4 (r − φ). The PID, 0.2 (1
/// + 1/(10 s) + s/(1 + s/10)), is matched at its period: zeros and poles e^{sh}, the same gain at s
/// = 0.1/h.
class BallAndBeam {
 public:
  enum : std::uint8_t { kPhi, kX, kSpeed, kPidA, kPidB, kR, kU, kStates };

  explicit BallAndBeam(double pid_period_s) {
    const double root = std::sqrt(10.1 * 10.1 - 44.0);
    const double at = 0.1 / pid_period_s, z = std::exp(0.1);
    const std::array<double, 2> zeros{std::exp(pid_period_s * (-10.1 + root) / 22.0),
                                      std::exp(pid_period_s * (-10.1 - root) / 22.0)};
    const std::array<double, 2> poles{1.0, std::exp(-10.0 * pid_period_s)};
    const double continuous = 0.2 * (1.0 + 1.0 / (10.0 * at) + at / (1.0 + at / 10.0));
    gain_ = continuous * (z - poles[0]) * (z - poles[1]) / ((z - zeros[0]) * (z - zeros[1]));
    denominator_ = {-(poles[0] + poles[1]), poles[0] * poles[1]};
    numerator_ = {-(zeros[0] + zeros[1]), zeros[0] * zeros[1]};
  }

  /// r from x, in the observer's form.
  MatrixXd pid() const {
    MatrixXd jump = MatrixXd::Identity(kStates, kStates);
    jump.row(kR).setZero();
    jump(kR, kPidA) = 1.0;
    jump(kR, kX) = gain_;
    jump.row(kPidA).setZero();
    jump(kPidA, kPidB) = 1.0;
    jump(kPidA, kX) = gain_ * numerator_[0];
    jump.row(kPidA) -= denominator_[0] * jump.row(kR);
    jump.row(kPidB).setZero();
    jump(kPidB, kX) = gain_ * numerator_[1];
    jump.row(kPidB) -= denominator_[1] * jump.row(kR);
    return jump;
  }
  static MatrixXd inner() {
    MatrixXd jump = MatrixXd::Identity(kStates, kStates);
    jump.row(kU).setZero();
    jump(kU, kR) = 4.0;
    jump(kU, kPhi) = -4.0;
    return jump;
  }
  static EventInterval during(double h_s) {
    MatrixXd a = MatrixXd::Zero(kStates, kStates), r = a, q = a;
    a(kPhi, kU) = 4.4;
    a(kX, kSpeed) = 1.0;
    a(kSpeed, kPhi) = -9.0;
    r(kPhi, kPhi) = 4.4 * 4.4;
    q(kPhi, kPhi) = q(kX, kX) = 1.0;
    return between_events(a, r, q, h_s);
  }

 private:
  double gain_ = 0.0;
  std::array<double, 2> denominator_{}, numerator_{};
};

TEST(JitterbugOracle, ABallOnABeamWithOneRateAndWithTwo) {
  const BallAndBeam slow(0.1), fast(0.05);
  const MatrixXd inner = BallAndBeam::inner();
  const EventInterval half = BallAndBeam::during(0.05);
  EXPECT_NEAR(mean_cost({inner * slow.pid()}, BallAndBeam::during(0.1), 0.1), 3.3955, 5e-5)
      << "the manual's 3.40";
  EXPECT_NEAR(mean_cost({inner * fast.pid()}, half, 0.05), 1.9329, 5e-5) << "1.93";
  EXPECT_NEAR(mean_cost({inner * slow.pid(), inner}, half, 0.05), 1.9910, 5e-5) << "1.99";
}

/// 6/((s + 1)(s + 2)), sampled every h = 1.42 s; u = −y after a delay that is uniform on the
/// multiples of h/50 from 0 to `most_s`.
double radius_with_jitter(double most_s) {
  constexpr double kPeriodS = 1.42;
  const MatrixXd a = rows(3, {0, 1, 0, -2, -3, 6, 0, 0, 0});  // y, ẏ, u
  const MatrixXd none = MatrixXd::Zero(3, 3);
  MatrixXd actuate = MatrixXd::Zero(4, 4);  // y, ẏ, u, the sample
  actuate.diagonal() << 1, 1, 0, 1;
  actuate(2, 3) = -1.0;
  std::vector<MatrixXd> modes;
  const auto pass = [&](double h_s) {
    MatrixXd phi = MatrixXd::Identity(4, 4);
    if (h_s > 0.0) phi.topLeftCorner(3, 3) = between_events(a, none, none, h_s).phi;
    return phi;
  };
  MatrixXd sample = MatrixXd::Identity(4, 4);
  sample.row(3) << 1, 0, 0, 0;
  const int delays = static_cast<int>(std::lround(50.0 * most_s / kPeriodS)) + 1;
  for (int i = 0; i < delays; ++i) {
    const double delay_s = kPeriodS * i / 50.0;
    modes.emplace_back(pass(kPeriodS - delay_s) * actuate * pass(delay_s) * sample);
  }
  const auto n = static_cast<std::size_t>(delays);
  return mean_square_radius(Matrix(n, std::vector<double>(n, 1.0 / delays)), modes);
}

TEST(KushnerOracle, JitterCanStabilise) {
  // Own values of an independent program; Jitterbug's example prints none.
  EXPECT_NEAR(radius_with_jitter(0.0), 0.978, 5e-4);
  EXPECT_NEAR(radius_with_jitter(0.1), 0.578, 5e-4);
  EXPECT_NEAR(radius_with_jitter(0.6), 0.931, 5e-4);
  EXPECT_NEAR(radius_with_jitter(0.8), 1.108, 5e-4);
}

}  // namespace
}  // namespace tether
