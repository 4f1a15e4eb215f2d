#pragma once

#include <cstddef>
#include <vector>

namespace tether {

/// The interpolating cubic spline with a continuous second derivative (de Boor, A Practical Guide
/// to Splines, chapter IV). It is ours because Boost's interpolators want even knots for that, or
/// given slopes, and Eigen's splines know neither natural nor periodic ends.
class CubicSpline {
 public:
  enum class Ends {
    natural,  ///< no second derivative at the ends
    periodic  ///< both ends are one point, which the spline passes as smoothly as the others
  };
  struct Value {
    double y = 0.0, first = 0.0, second = 0.0;  ///< with its derivatives
  };

  /// Through (u_k, y_k): u strictly ascending, two points or more; periodic: y begins and ends with
  /// the same value, four points or more.
  CubicSpline(std::vector<double> u, std::vector<double> y, Ends ends);

  /// `segment` is k of u_k <= u <= u_{k+1}.
  Value at(std::size_t segment, double u) const;

 private:
  std::vector<double> u_, y_;
  std::vector<double> second_;  // second derivatives at u_k
};

}  // namespace tether
