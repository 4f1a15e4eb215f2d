#pragma once

#include <functional>

namespace tether {

/// Where along a range a loop stops being stable.
struct Critical {
  enum class Kind {
    found,
    always,        ///< stable in the whole range
    never,         ///< nowhere stable
    not_monotone,  ///< it changes sides more than once: there is no single critical value
  };
  Kind kind = Kind::never;
  double value = 0.0;  ///< found: to `tolerance`

  bool operator==(const Critical&) const = default;
};

/// Bisection of radius(x) = 1 between `low` and `high`. Assumes that the radius passes 1 once, from
/// either side, and checks that on 25 points. A radius just at 1 counts as stable to 1e-7: so does
/// a loop that has nothing to correct.
Critical critical_value(const std::function<double(double)>& radius, double low, double high,
                        double tolerance);

}  // namespace tether
