#include "sim/plant/true_start.hpp"

#include <boost/random/normal_distribution.hpp>
#include <cmath>

namespace tether {

VehicleSettings at_true_start(const VehicleSettings& vehicle, RandomEngine random) {
  boost::random::normal_distribution<double> normal;
  const auto truncated = [&] {
    double z = normal(random);
    while (std::abs(z) > kStartErrorSigmas) z = normal(random);
    return z;
  };
  VehicleSettings real = vehicle;
  real.start_x_m += vehicle.start_error_m * truncated();
  real.start_y_m += vehicle.start_error_m * truncated();
  real.start_yaw_rad += vehicle.start_error_rad * truncated();
  return real;
}

}  // namespace tether
