#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/motion_model.hpp"

namespace tether {

/// Minimise x·Hx/2 + g·x with lower ≤ x ≤ upper; H is symmetric and positive definite.
struct BoxQp {
  std::vector<double> hessian;  ///< H, n × n, row by row
  std::vector<double> gradient;
  std::vector<double> lower, upper;
};

/// The minimum, from a start within the bounds, or nullopt if the solver failed. Deterministic;
/// calls share nothing.
///
/// By NLopt's L-BFGS with bounds (L. Lukšan's subroutines). docs/explanation/benchmark.md compares
/// it with other solvers.
std::optional<std::vector<double>> solve(const BoxQp& qp, std::vector<double> start);

/// [controller.mpc]
struct MpcSettings {
  double steps = 40.0;      ///< number of optimised steps per plan
  double heading_m2 = 0.5;  ///< a radian of heading weighs as much as the root of this in metres
  double rim_s2 = 0.01;     ///< the same of a change of 1 m/s of a rim, other than the path's
  double terminal = 10.0;   ///< the last step's errors weigh as much as those of so many
  double within_m = 1.0;    ///< farther off the path, the roll-out is taken as it is
  double iterations = 2.0;  ///< number of linearisations

  bool operator==(const MpcSettings&) const = default;
};

/// Model predictive control of the first steps of a plan: the rim speeds l_k, r_k at the ends of
/// its steps that minimise
///
///   Σ_k  w_k (‖p_k − p_r(t_k)‖² + heading (θ_k − θ_r(t_k))²)  +  rim Σ_k ‖Δ_k − Δ_r,k‖²
///
/// on MotionModel, with the changes Δ_k of both rim speeds in a step within the vehicle's
/// acceleration; w_k is 1, and `terminal` for the last step. From a guess (the tracking law's
/// roll-out), the model is linearised along the trajectory, which gives a quadratic program in the
/// 2N changes with bounds, and again along its solution (sequential quadratic programming; J. B.
/// Rawlings, D. Q. Mayne, M. M. Diehl: Model Predictive Control, 2nd ed., chapter 8; for wheeled
/// robots F. Kühne, W. F. Lages, J. M. Gomes da Silva: Model predictive control of a mobile robot
/// using linearization, 2004 — both quoted from memory). A solution that is not better than what it
/// began with, by the cost above on the model itself, is dropped: the result is never worse than
/// the guess. Speed limits are those of the model that follows the result: MotionModel::reachable.
class MpcPlanner {
 public:
  MpcPlanner(const MpcSettings& settings, std::shared_ptr<const ReferencePath> path);

  /// The twists to be reached by the ends of the first steps, from `from` at `start_s` on; at most
  /// as many as `guess` has, which begins there as well. Empty: farther off than within_m.
  std::vector<Twist> improve(const MotionModel& model, const MotionModel::State& from,
                             double start_s, double step_s, std::vector<Twist> guess);

  std::size_t steps() const { return static_cast<std::size_t>(settings_.steps); }

  /// How often the solver failed or its solution was no better.
  std::int64_t failures() const { return failures_; }

 private:
  struct Trajectory;
  struct Linear;
  using Rims = std::vector<WheelSpeeds>;
  Trajectory drive(const MotionModel& model, MotionModel::State state, double start_s,
                   double step_s, const Rims& rims) const;
  BoxQp linearise(const MotionModel& model, const MotionModel::State& from, const Trajectory& along,
                  const Rims& rims, double step_s) const;

  MpcSettings settings_;
  std::shared_ptr<const ReferencePath> path_;
  std::int64_t failures_ = 0;
};

}  // namespace tether
