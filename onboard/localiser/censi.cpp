#include "onboard/localiser/censi.hpp"

#include <cmath>

namespace tether {

PoseInformation censi_information(std::span<const SeenOutline> beams, double sigma_m,
                                  double yaw_rad, const Pose2& mount) {
  // How the scanner moves as the vehicle turns about its reference point.
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  const double swing_x_m = -s * mount.x_m - c * mount.y_m;
  const double swing_y_m = c * mount.x_m - s * mount.y_m;
  PoseInformation information;
  for (const SeenOutline& beam : beams) {
    const double incidence_rad = beam.normal_rad - beam.direction_rad;
    // How the range grows: by x, y and yaw of the scanner.
    const double by_x = -std::cos(beam.normal_rad) / std::cos(incidence_rad);
    const double by_y = -std::sin(beam.normal_rad) / std::cos(incidence_rad);
    const double by_yaw_m = -beam.range_m * std::tan(incidence_rad);
    information.add(by_x, by_y, by_yaw_m + by_x * swing_x_m + by_y * swing_y_m,
                    1.0 / (sigma_m * sigma_m));
  }
  return information;
}

}  // namespace tether
