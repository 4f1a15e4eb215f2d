#pragma once

#include <Eigen/Core>
#include <functional>

namespace tether {

using Objective = std::function<double(const Eigen::VectorXd&)>;

/// A local maximum of a smooth function.
struct Maximum {
  Eigen::VectorXd at;
  double value = 0.0;
  /// Inverse of minus the Hessian there: of a log-likelihood, the covariance of its estimates by
  /// the observed information. Empty if the Hessian is not negative definite (not identifiable, or
  /// at a bound).
  Eigen::MatrixXd covariance;
};

/// Climbs from `start` by BFGS with central differences (Nocedal & Wright, Numerical Optimization,
/// chapter 6); arguments are kept within ±kBound and are meant to be logits or logarithms.
/// `objective` may return −infinity, but not at `start`.
Maximum maximise(const Objective& objective, Eigen::VectorXd start);

inline constexpr double kBound = 25.0;

}  // namespace tether
