#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <limits>

namespace tether {

/// A value that a fit cannot determine.
inline constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// A share for any number: what is between 0 and 1 is searched for without bounds.
inline double logistic(double u) { return 1.0 / (1.0 + std::exp(-u)); }

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
