#include "common/path/planned_path.hpp"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "common/base/errors.hpp"
#include "common/path/simple_curves.hpp"
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

std::unique_ptr<const PathCurve> curve_through(const Scenario::Path& config) {
  if (config.csv.empty()) {
    throw UsageError("path.kind = \"csv\" needs path.csv, a file of waypoints");
  }
  const Waypoints waypoints = load_waypoints(config.csv);
  auto curve = std::make_unique<const WaypointCurve>(waypoints);
  check_wishes(waypoints, *curve, config.limits);
  return curve;
}

std::unique_ptr<const PathCurve> make_curve(const Scenario::Path& config) {
  using Kind = Scenario::Path::Kind;
  switch (config.kind) {
    case Kind::circle:
      return std::make_unique<CircleCurve>(config.start, config.radius_m, config.clockwise);
    case Kind::line:
      return std::make_unique<StraightCurve>(config.start, config.length_m);
    case Kind::rounded_rectangle:
      return std::make_unique<RoundedRectangleCurve>(
          config.start, RoundedRectangleCurve::Config{config.length_m, config.width_m,
                                                      config.corner_radius_m, config.clockwise});
    case Kind::csv:
      return curve_through(config);
    case Kind::figure_eight:
      break;
  }
  return nullptr;
}

}  // namespace

PathPoint PlannedPath::point(const SpeedProfile::Motion& motion) const {
  const CurvePoint p = curve_->at(motion.s_m);
  return {p.x_m, p.y_m, p.yaw_rad, motion.v_mps, motion.v_mps * p.curvature_1pm};
}

std::unique_ptr<const PlannedPath> plan_path(const Scenario::Path& config) {
  auto curve = make_curve(config);
  if (!curve) return nullptr;
  return std::make_unique<const PlannedPath>(std::move(curve), config.limits);
}

}  // namespace tether
