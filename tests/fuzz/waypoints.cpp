#include "common/path/waypoints.hpp"

#include <cmath>
#include <sstream>

#include "common/path/planned_path.hpp"
#include "common/path/waypoint_curve.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// Waypoints that are read give a path, finite everywhere, or are refused when it is planned.
void try_input(std::span<const std::uint8_t> input) {
  std::istringstream in(text_of(input));
  takes([&] {
    const Waypoints waypoints = read_waypoints(in, "path.csv");
    const PlannedPath path(std::make_unique<WaypointCurve>(waypoints), PathLimits{});
    for (const double t_s : {0.0, 0.1, 1.0, 17.0, 1e4}) {
      const PathPoint point = path.at(t_s);
      must(std::isfinite(point.x_m) && std::isfinite(point.y_m),
           "a path is somewhere at all times");
      must(std::isfinite(point.v_mps) && std::isfinite(point.omega_radps), "its twist is finite");
    }
  });
}

}  // namespace tether::fuzzing
