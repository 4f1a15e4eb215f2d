#include "common/world/stopping_field.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

double StoppingField::length_m(double v_mps) const {
  const double speed_mps = std::abs(v_mps);
  return speed_mps * speed_mps / (2.0 * deceleration_mps2) + speed_mps * reaction_s + margin_m;
}

double StoppingField::allowed_mps(double clear_m) const {
  const double way_m = std::max(clear_m - margin_m, 0.0);
  const double at_m = deceleration_mps2 * reaction_s;
  return std::sqrt(at_m * at_m + 2.0 * deceleration_mps2 * way_m) - at_m;
}

}  // namespace tether
