#include "common/path/check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "common/base/errors.hpp"
#include "common/vehicle/diff_drive.hpp"

namespace tether {
namespace {

constexpr double kSlack = 1e-9;  // relative
constexpr double kTouch_m = 1e-6;

PathDemand demand(const PathPoint& from, const PathPoint& to, double dt_s, double track_m) {
  const WheelSpeeds before = to_wheel_speeds({from.v_mps, from.omega_radps}, track_m);
  const WheelSpeeds after = to_wheel_speeds({to.v_mps, to.omega_radps}, track_m);
  PathDemand d;
  d.point = to;
  d.acceleration_mps2 = (to.v_mps - from.v_mps) / dt_s;
  d.yaw_acceleration_radps2 = (std::abs(to.omega_radps) - std::abs(from.omega_radps)) / dt_s;
  d.rim_speed_mps = std::max(std::abs(after.left_mps), std::abs(after.right_mps));
  d.rim_acceleration_mps2 = std::max(std::abs(after.left_mps - before.left_mps),
                                     std::abs(after.right_mps - before.right_mps)) /
                            dt_s;
  return d;
}

/// How far the vehicle's outline, the chassis box and both wheels, reaches in x or y.
double reach_m(const VehicleConfig& v, const PathPoint& p) {
  const double cosine = std::cos(p.yaw_rad), sine = std::sin(p.yaw_rad);
  double reach = 0.0;
  const auto add = [&](double from_x, double to_x, double half_y) {
    for (const double x : {from_x, to_x}) {
      for (const double y : {-half_y, half_y}) {
        reach = std::max({reach, std::abs(p.x_m + cosine * x - sine * y),
                          std::abs(p.y_m + sine * x + cosine * y)});
      }
    }
  };
  const double half = 0.5 * v.chassis_length_m;
  add(-half - v.axle_x_m, half - v.axle_x_m, 0.5 * v.chassis_width_m);
  add(-v.wheel_radius_m, v.wheel_radius_m, 0.5 * (v.track_m + v.wheel_width_m));
  return reach;
}

[[noreturn]] void refuse(const PlannedPath& path, const SpeedProfile::Motion& at,
                         const std::string& source, const std::string& what) {
  const std::string file = path.curve().source(at.s_m);
  const PathPoint p = path.point(at);
  throw UsageError(fmt::format("{}: {:.2f} m along the path, at ({:.2f}, {:.2f}) m, {}",
                               file.empty() ? source : file, at.s_m, p.x_m, p.y_m, what));
}

}  // namespace

void check_path(const PlannedPath& path, const VehicleConfig& vehicle, double half_extent_m,
                const std::vector<PathLimit>& limits, const std::string& source) {
  const auto steps = path.profile().steps();
  PathPoint last = path.point(steps.front());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const PathPoint point = path.point(steps[i]);
    const double reach = reach_m(vehicle, point);
    if (reach > half_extent_m + kTouch_m) {
      refuse(path, steps[i], source,
             fmt::format("the vehicle would be in or beyond a wall: its outline reaches {:.2f} m; "
                         "world.half_extent_m = {}",
                         reach, half_extent_m));
    }
    if (i == 0) continue;
    const PathDemand d = demand(last, point, steps[i].t_s - steps[i - 1].t_s, vehicle.track_m);
    last = point;
    for (const PathLimit& limit : limits) {
      const double value = limit.of(d);
      if (value <= limit.value * (1.0 + kSlack)) continue;
      refuse(path, steps[i], source,
             fmt::format("the path needs {} of {:.3f} {}; {} = {}", limit.what, value, limit.unit,
                         limit.key, limit.value));
    }
  }
}

}  // namespace tether
