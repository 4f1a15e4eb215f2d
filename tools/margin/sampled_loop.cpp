#include "tools/margin/sampled_loop.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <unsupported/Eigen/MatrixFunctions>

namespace tether {
namespace {

using Eigen::MatrixXd;

/// How errors and twists move errors during some time: e⁺ = Φ e + Γ (u − u_r).
struct Motion {
  Eigen::Matrix3d phi;
  Eigen::Matrix<double, 3, 2> gamma;
};

Motion motion_in(const PathMotion& path, double during_s) {
  Eigen::Matrix<double, 5, 5> rates = Eigen::Matrix<double, 5, 5>::Zero();
  rates(0, 1) = path.omega_radps;
  rates(1, 0) = -path.omega_radps;
  rates(1, 2) = path.v_mps;
  rates(0, 3) = rates(2, 4) = -1.0;
  const Eigen::Matrix<double, 5, 5> moved = (rates * during_s).exp();
  return {moved.topLeftCorner<3, 3>(), moved.topRightCorner<3, 2>()};
}

/// The path's own twist, from the state's last component.
MatrixXd reference_rows(const PathMotion& path, Eigen::Index n) {
  MatrixXd rows = MatrixXd::Zero(2, n);
  rows(0, n - 1) = path.v_mps;
  rows(1, n - 1) = path.omega_radps;
  return rows;
}

/// From a pose to the next, of a loop of plans.
struct PlannedMotion {
  /// Dynamics of e − ê, which is not controlled.
  Eigen::Matrix3d open = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d closed = Eigen::Matrix3d::Identity();  ///< how ê moves: as the law has it

  explicit PlannedMotion(const PlannedPeriod& period) {
    const Motion motion = motion_in(period.path, period.step_s);
    const Eigen::Matrix3d steered = motion.phi + motion.gamma * period.law;
    for (int i = 0; i < period.steps; ++i) {
      open = motion.phi * open;
      closed = steered * closed;
    }
  }
};

constexpr double kRounding = 1e-9;  // rounding of a delay in periods

}  // namespace

LawJacobian tracking_jacobian(double k_x, double k_y, double k_theta, double v_mps) {
  LawJacobian k;
  k << k_x, 0.0, 0.0, 0.0, v_mps * k_y, v_mps * k_theta;
  return k;
}

LoopStep sampled_step(const LoopPeriod& period, const LoopTiming& timing, const PoseNoise& noise) {
  const double h_s = timing.period_s;
  const auto whole = static_cast<Eigen::Index>(std::floor(timing.total_s() / h_s + kRounding));
  const double part_s = std::max(0.0, timing.total_s() - static_cast<double>(whole) * h_s);
  const Eigen::Index n = 6 + 2 * whole;
  const MatrixXd one = MatrixXd::Identity(n, n);

  MatrixXd answer = reference_rows(period.decided, n);
  answer.leftCols(3) += period.law;
  const MatrixXd held = one.middleRows(3, 2);
  const MatrixXd arriving = whole == 0 ? answer : MatrixXd(one.middleRows(3 + 2 * whole, 2));
  const Motion first = motion_in(period.early, part_s);
  const Motion then = motion_in(period.late, h_s - part_s);
  const MatrixXd middle =
      first.phi * one.topRows(3) + first.gamma * (held - reference_rows(period.early, n));

  const Eigen::Vector3d sigma(noise.position_m, noise.position_m, noise.yaw_rad);
  const MatrixXd noisy = period.law * sigma.asDiagonal();
  LoopStep step;
  for (const std::size_t mode : {LossChain::kReceived, LossChain::kLost}) {
    const MatrixXd in_force = mode == LossChain::kReceived ? arriving : held;
    MatrixXd a = MatrixXd::Zero(n, n);
    a.topRows(3) = then.phi * middle + then.gamma * (in_force - reference_rows(period.late, n));
    a.middleRows(3, 2) = in_force;
    MatrixXd g = MatrixXd::Zero(n, 3);
    if (whole > 0) {
      a.middleRows(5, 2) = answer;
      a.middleRows(7, 2 * whole - 2) = one.middleRows(5, 2 * whole - 2);
      g.middleRows(5, 2) = noisy;
    } else if (mode == LossChain::kReceived) {
      g.topRows(3) = then.gamma * noisy;
      g.middleRows(3, 2) = noisy;
    }
    a(n - 1, n - 1) = 1.0;
    step.a[mode] = a;
    step.noise[mode] = g * g.transpose();
  }
  for (Eigen::Index i = 0; i < n; ++i) step.is_along.push_back(i == 0 || (i >= 3 && i % 2 == 1));
  return step;
}

LoopStep planned_step(const PlannedPeriod& period, const PoseNoise& noise) {
  const auto& [open, closed] = PlannedMotion(period);
  const Eigen::Vector3d sigma(noise.position_m, noise.position_m, noise.yaw_rad);
  MatrixXd lost = MatrixXd::Identity(7, 7), received = lost;
  lost.block<3, 3>(0, 0) = open;
  lost.block<3, 3>(0, 3) = closed - open;
  lost.block<3, 3>(3, 3) = closed;
  received.block<3, 3>(0, 0) = received.block<3, 3>(3, 0) = closed;
  received.block<3, 3>(3, 3).setZero();
  MatrixXd measured = MatrixXd::Zero(7, 3);
  measured.topRows(3) = (closed - open) * sigma.asDiagonal();
  measured.middleRows(3, 3) = closed * sigma.asDiagonal();
  LoopStep step;
  step.a = {received, lost};
  step.noise = {measured * measured.transpose(), MatrixXd::Zero(7, 7)};
  step.is_along = {true, false, false, true, false, false, false};
  return step;
}

LoopStep part_of(const LoopStep& step, LoopPart part) {
  std::vector<Eigen::Index> kept;
  for (Eigen::Index i = 0; i + 1 < step.a[0].rows(); ++i) {
    const bool is_along = step.is_along[static_cast<std::size_t>(i)];
    if (part == LoopPart::all || is_along == (part == LoopPart::along)) kept.push_back(i);
  }
  LoopStep result;
  for (const std::size_t mode : {LossChain::kReceived, LossChain::kLost}) {
    result.a[mode] = step.a[mode](kept, kept);
    result.noise[mode] = step.noise[mode](kept, kept);
  }
  return result;
}

double planned_radius(const LossChain& chain, const PlannedPeriod& period, LoopPart part) {
  const Eigen::Matrix3d closed = PlannedMotion(period).closed;
  MatrixXd looked_at = closed;
  if (part == LoopPart::along) looked_at = closed.topLeftCorner<1, 1>();
  if (part == LoopPart::across) looked_at = closed.bottomRightCorner<2, 2>();
  const double shrinks = looked_at.eigenvalues().cwiseAbs().maxCoeff();
  LoopStep silence;
  silence.a = {MatrixXd::Zero(1, 1), MatrixXd::Ones(1, 1)};
  return std::max(shrinks * shrinks, mean_square_radius(chain, {silence}));
}

double square_distance(const MatrixXd& moments, double ahead_m) {
  const Eigen::Index last = moments.rows() - 1;
  return moments(0, 0) - 2.0 * ahead_m * moments(0, last) + ahead_m * ahead_m + moments(1, 1);
}

double SteeringLoop::crossover_radps() const {
  const double a = k_theta * v_mps, b = k_y * v_mps * v_mps;
  return std::sqrt(0.5 * (a * a + std::sqrt(a * a * a * a + 4.0 * b * b)));
}

double SteeringLoop::delay_margin_s() const {
  const double omega = crossover_radps();
  return std::atan(k_theta * v_mps * omega / (k_y * v_mps * v_mps)) / omega;
}

double SteeringLoop::varying_delay_margin_s() const {
  const double a = k_theta * v_mps, b = k_y * v_mps * v_mps;
  double most = a;  // in the limit of large ω
  const double about = std::sqrt(b);
  for (double omega = 1e-2 * about; omega < 1e3 * about; omega *= 1.001) {
    const std::complex<double> s(0.0, omega);
    most = std::max(most, std::abs(s * (a * s + b) / (s * s + a * s + b)));
  }
  return 1.0 / most;
}

}  // namespace tether
