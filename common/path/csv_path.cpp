#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/waypoint_curve.hpp"
#include "common/path/waypoints.hpp"

namespace tether {
namespace {

/// Speeds that the file asks for must be possible at their waypoints; elsewhere the profile slows
/// down by itself.
void check_wishes(const Waypoints& waypoints, const WaypointCurve& curve,
                  const PathLimits& limits) {
  for (std::size_t i = 0; i < waypoints.points.size(); ++i) {
    const Waypoint& waypoint = waypoints.points[i];
    if (!waypoint.v_mps) return;
    const double bend = std::abs(curve.at(curve.waypoints_s_m()[i]).curvature_1pm);
    const double v_mps = std::min(*waypoint.v_mps, limits.speed_mps);
    const auto refuse = [&](const char* key, double limit, double possible_mps) {
      throw UsageError(fmt::format(
          "{}:{}: v_mps = {} is not possible: at this waypoint the path bends with a radius of "
          "{:.3f} m, where {} = {} allows {:.3f} m/s",
          waypoints.file, waypoint.line, *waypoint.v_mps, 1.0 / bend, key, limit, possible_mps));
    };
    if (v_mps * bend > limits.max_yaw_rate_radps) {
      refuse("path.max_yaw_rate_radps", limits.max_yaw_rate_radps,
             limits.max_yaw_rate_radps / bend);
    }
    if (v_mps * v_mps * bend > limits.max_lateral_acceleration_mps2) {
      refuse("path.max_lateral_acceleration_mps2", limits.max_lateral_acceleration_mps2,
             std::sqrt(limits.max_lateral_acceleration_mps2 / bend));
    }
  }
}

std::unique_ptr<const PathCurve> curve_through(const PathSettings& settings) {
  if (settings.csv.empty()) {
    throw UsageError("path.kind = \"csv\" needs path.csv, a file of waypoints");
  }
  const Waypoints waypoints = load_waypoints(settings.csv);
  auto curve = std::make_unique<const WaypointCurve>(waypoints);
  check_wishes(waypoints, *curve, settings.limits);
  return curve;
}

}  // namespace

PathKind csv_path() {
  return {.name = "csv",
          .keys = {"csv", "speed_mps", "max_acceleration_mps2", "max_deceleration_mps2",
                   "max_lateral_acceleration_mps2", "max_yaw_rate_radps",
                   "max_yaw_acceleration_radps2"},
          .curve = curve_through};
}

}  // namespace tether
