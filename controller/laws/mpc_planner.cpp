#include "controller/laws/mpc_planner.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <nlopt.hpp>
#include <stdexcept>
#include <utility>

namespace tether {
namespace {

using Eigen::Map;
using Eigen::VectorXd;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

constexpr double kTolerance = 1e-9;  // tolerance of the cost, relative
constexpr int kMostEvaluations = 500;

double cost(const std::vector<double>& x, std::vector<double>& slope, void* data) {
  const auto& qp = *static_cast<const BoxQp*>(data);
  const auto n = static_cast<Eigen::Index>(x.size());
  const Map<const VectorXd> at(x.data(), n), gradient(qp.gradient.data(), n);
  const VectorXd h = Map<const Matrix>(qp.hessian.data(), n, n) * at;
  if (!slope.empty()) Map<VectorXd>(slope.data(), n) = h + gradient;
  return 0.5 * at.dot(h) + gradient.dot(at);
}

}  // namespace

std::optional<std::vector<double>> solve(const BoxQp& qp, std::vector<double> start) {
  nlopt::opt search(nlopt::LD_LBFGS, static_cast<unsigned>(start.size()));
  BoxQp data = qp;
  search.set_min_objective(cost, &data);
  search.set_lower_bounds(qp.lower);
  search.set_upper_bounds(qp.upper);
  search.set_ftol_rel(kTolerance);
  search.set_maxeval(kMostEvaluations);
  double least = 0.0;
  try {
    search.optimize(start, least);
  } catch (const nlopt::roundoff_limited&) {  // the result is as good as rounding allows
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
  return start;
}

namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using Jacobian = Eigen::Matrix<double, 5, 5>;
using Gain = Eigen::Matrix<double, 5, 2>;

/// How the state (x, y, θ, l, r) at a step's end depends on the one at its begin and on the changes
/// of both rim speeds.
struct Step {
  Jacobian a = Jacobian::Identity();
  Gain b = Gain::Zero();
};

/// A wheel that goes from s to s + Δ at the acceleration a and stays there rolls
/// D = (s + Δ) h − Δ |Δ|/(2 a): ∂D/∂s = h, ∂D/∂Δ = h − |Δ|/a. Then both wheels' ways move the
/// axle's midpoint by (D_l + D_r)/2 in direction θ + (D_r − D_l)/(2 track).
Step step_of(double yaw_rad, const WheelSpeeds& before, const WheelSpeeds& after, double track_m,
             double acceleration_mps2, double step_s) {
  const double speed[2] = {after.left_mps, after.right_mps};
  const double change[2] = {after.left_mps - before.left_mps, after.right_mps - before.right_mps};
  double way_m[2], by_change_s[2];
  for (const int i : {0, 1}) {
    const double ramp_s = std::abs(change[i]) / acceleration_mps2;
    way_m[i] = speed[i] * step_s - 0.5 * change[i] * ramp_s;
    by_change_s[i] = step_s - ramp_s;
  }
  const double arc_m = 0.5 * (way_m[0] + way_m[1]);
  const double heading_rad = yaw_rad + 0.5 * (way_m[1] - way_m[0]) / track_m;
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  Step step;
  step.a(0, 2) = -arc_m * s;
  step.a(1, 2) = arc_m * c;
  for (const int i : {0, 1}) {
    const double turn = (i == 0 ? -1.0 : 1.0) / track_m;
    const Eigen::Vector3d by_way(0.5 * c - 0.5 * arc_m * s * turn, 0.5 * s + 0.5 * arc_m * c * turn,
                                 turn);
    step.a.block<3, 1>(0, 3 + i) = by_way * step_s;
    step.b.block<3, 1>(0, i) = by_way * by_change_s[i];
    step.b(3 + i, i) = 1.0;
  }
  return step;
}

double square(double x) { return x * x; }

}  // namespace

/// Trajectory that results from a sequence of rim speeds.
struct MpcPlanner::Trajectory {
  std::vector<Pose2> poses;         ///< at the begin, and at the end of each step
  std::vector<Pose2> errors;        ///< to the path, at the end of each step; yaw wrapped
  std::vector<WheelSpeeds> excess;  ///< excess of each change over the path's own
  double cost = 0.0;

  double weight(std::size_t k, double terminal) const {
    return k + 1 == errors.size() ? terminal : 1.0;
  }
};

MpcPlanner::MpcPlanner(const MpcSettings& settings, std::shared_ptr<const ReferencePath> path)
    : settings_(settings), path_(std::move(path)) {}

std::vector<Twist> MpcPlanner::improve(const MotionModel& model, const MotionModel::State& from,
                                       double start_s, double step_s, std::vector<Twist> guess) {
  const PathPoint here = path_->at(start_s);
  if (std::hypot(here.x_m - from.pose.x_m, here.y_m - from.pose.y_m) > settings_.within_m)
    return {};
  if (guess.size() > static_cast<std::size_t>(settings_.steps)) {
    guess.resize(static_cast<std::size_t>(settings_.steps));
  }
  Rims rims;
  for (const Twist& twist : guess) rims.push_back(model.rim_of(twist));
  Trajectory best = drive(model, from, start_s, step_s, rims);
  for (int i = 0; i < static_cast<int>(settings_.iterations); ++i) {
    const BoxQp qp = linearise(model, from, best, rims, step_s);
    const auto changes = solve(qp, std::vector<double>(qp.gradient.size(), 0.0));
    if (!changes) {
      ++failures_;
      break;
    }
    Rims other = rims;
    WheelSpeeds sum;
    for (std::size_t k = 0; k < other.size(); ++k) {
      sum.left_mps += (*changes)[2 * k];
      sum.right_mps += (*changes)[2 * k + 1];
      other[k].left_mps += sum.left_mps;
      other[k].right_mps += sum.right_mps;
    }
    Trajectory tried = drive(model, from, start_s, step_s, other);
    if (!(tried.cost < best.cost)) {
      if (i == 0) ++failures_;
      break;
    }
    best = std::move(tried);
    rims = std::move(other);
  }
  for (std::size_t k = 0; k < rims.size(); ++k) {
    guess[k] = to_twist(rims[k], model.limits().track_m);
  }
  return guess;
}

/// Along the model without what is known of the drive: commands allow for that.
MpcPlanner::Trajectory MpcPlanner::drive(const MotionModel& model, MotionModel::State state,
                                         double start_s, double step_s, const Rims& rims) const {
  const MotionModel ideal(model.limits());
  Trajectory t;
  t.poses.push_back(state.pose);
  const auto rim_at = [&](double t_s) {
    const PathPoint p = path_->at(t_s);
    return model.rim_of({p.v_mps, p.omega_radps});
  };
  WheelSpeeds own_before = rim_at(start_s);
  for (std::size_t k = 0; k < rims.size(); ++k) {
    const double end_s = start_s + static_cast<double>(k + 1) * step_s;
    const WheelSpeeds before = state.rim;
    ideal.advance(state, to_twist(rims[k], model.limits().track_m), step_s);
    const PathPoint p = path_->at(end_s);
    const Pose2 error{state.pose.x_m - p.x_m, state.pose.y_m - p.y_m,
                      wrap_angle(state.pose.yaw_rad - p.yaw_rad)};
    const WheelSpeeds own = rim_at(end_s);
    const WheelSpeeds excess{
        state.rim.left_mps - before.left_mps - own.left_mps + own_before.left_mps,
        state.rim.right_mps - before.right_mps - own.right_mps + own_before.right_mps};
    own_before = own;
    t.poses.push_back(state.pose);
    t.errors.push_back(error);
    t.excess.push_back(excess);
    t.cost += settings_.rim_s2 * (square(excess.left_mps) + square(excess.right_mps));
  }
  for (std::size_t k = 0; k < t.errors.size(); ++k) {
    const Pose2& e = t.errors[k];
    t.cost += t.weight(k, settings_.terminal) *
              (square(e.x_m) + square(e.y_m) + settings_.heading_m2 * square(e.yaw_rad));
  }
  return t;
}

/// The cost of changes of the rims' changes, to second order (Gauss–Newton), and their bounds.
BoxQp MpcPlanner::linearise(const MotionModel& model, const MotionModel::State& from,
                            const Trajectory& along, const Rims& rims, double step_s) const {
  const auto n = static_cast<Eigen::Index>(2 * rims.size());
  const double acceleration_mps2 = model.limits().max_wheel_acceleration_mps2;
  const double most_mps = acceleration_mps2 * step_s;
  MatrixXd hessian = MatrixXd::Zero(n, n);
  VectorXd gradient = VectorXd::Zero(n);
  Eigen::Matrix<double, 5, Eigen::Dynamic> by_changes =
      Eigen::Matrix<double, 5, Eigen::Dynamic>::Zero(5, n);
  BoxQp qp;
  WheelSpeeds before = from.rim;
  for (std::size_t k = 0; k < rims.size(); ++k) {
    const auto column = static_cast<Eigen::Index>(2 * k);
    const Step step = step_of(along.poses[k].yaw_rad, before, rims[k], model.limits().track_m,
                              acceleration_mps2, step_s);
    by_changes.leftCols(column) = (step.a * by_changes.leftCols(column)).eval();
    by_changes.middleCols<2>(column) = step.b;
    const double weight = along.weight(k, settings_.terminal);
    const Eigen::Vector3d weights(weight, weight, weight * settings_.heading_m2);
    const Pose2& e = along.errors[k];
    const auto upto = by_changes.topRows<3>().leftCols(column + 2);
    hessian.topLeftCorner(column + 2, column + 2).noalias() +=
        upto.transpose() * weights.asDiagonal() * upto;
    gradient.head(column + 2) +=
        upto.transpose() * weights.cwiseProduct(Eigen::Vector3d(e.x_m, e.y_m, e.yaw_rad));
    const double changes[2] = {rims[k].left_mps - before.left_mps,
                               rims[k].right_mps - before.right_mps};
    const double excess[2] = {along.excess[k].left_mps, along.excess[k].right_mps};
    for (const int i : {0, 1}) {
      hessian(column + i, column + i) += settings_.rim_s2;
      gradient(column + i) += settings_.rim_s2 * excess[i];
      qp.lower.push_back(std::min(0.0, -most_mps - changes[i]));
      qp.upper.push_back(std::max(0.0, most_mps - changes[i]));
    }
    before = rims[k];
  }
  qp.hessian.assign(hessian.data(), hessian.data() + hessian.size());
  qp.gradient.assign(gradient.data(), gradient.data() + gradient.size());
  return qp;
}

}  // namespace tether
