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

/// What the path asks of the vehicle from one step to the next.
struct Demand {
  PathPoint point;
  double acceleration_mps2 = 0.0;
  double yaw_acceleration_radps2 = 0.0;
  double rim_speed_mps = 0.0;
  double rim_acceleration_mps2 = 0.0;
};

Demand demand(const PathPoint& from, const PathPoint& to, double dt_s, double track_m) {
  const WheelSpeeds before = to_wheel_speeds({from.v_mps, from.omega_radps}, track_m);
  const WheelSpeeds after = to_wheel_speeds({to.v_mps, to.omega_radps}, track_m);
  Demand d;
  d.point = to;
  d.acceleration_mps2 = (to.v_mps - from.v_mps) / dt_s;
  d.yaw_acceleration_radps2 = (std::abs(to.omega_radps) - std::abs(from.omega_radps)) / dt_s;
  d.rim_speed_mps = std::max(std::abs(after.left_mps), std::abs(after.right_mps));
  d.rim_acceleration_mps2 = std::max(std::abs(after.left_mps - before.left_mps),
                                     std::abs(after.right_mps - before.right_mps)) /
                            dt_s;
  return d;
}

struct Limit {
  const char* what;
  const char* unit;
  std::string key;
  double value;
  double (*of)(const Demand&);
};

/// Those of what is between the path and the wheels.
std::vector<Limit> limits_of(const Scenario& s) {
  const auto speed = [](const Demand& d) { return d.point.v_mps; };
  const auto yaw_rate = [](const Demand& d) { return std::abs(d.point.omega_radps); };
  std::vector<Limit> limits{
      {"a speed", "m/s", "controller.v.limit", s.controller.v.limit, speed},
      {"a yaw rate", "rad/s", "controller.omega.limit", s.controller.omega.limit, yaw_rate},
      {"a wheel's rim speed", "m/s", "vehicle.max_wheel_speed_mps", s.vehicle.max_wheel_speed_mps,
       [](const Demand& d) { return d.rim_speed_mps; }},
      {"a wheel's rim acceleration", "m/s^2", "vehicle.max_wheel_acceleration_mps2",
       s.vehicle.max_wheel_acceleration_mps2,
       [](const Demand& d) { return d.rim_acceleration_mps2; }}};
  if (s.vehicle.plant == Scenario::Vehicle::Plant::ode) {
    limits.push_back({"a lateral acceleration", "m/s^2", "world.friction * world.gravity_mps2",
                      s.world.friction * s.world.gravity_mps2, [](const Demand& d) {
                        return d.point.v_mps * std::abs(d.point.omega_radps);
                      }});
  }
  if (s.vehicle.drivetrain != Scenario::Vehicle::Drivetrain::can) return limits;
  const auto faster = [](const Demand& d) { return d.acceleration_mps2; };
  const auto slower = [](const Demand& d) { return -d.acceleration_mps2; };
  const auto into_turn = [](const Demand& d) { return d.yaw_acceleration_radps2; };
  const auto out_of_turn = [](const Demand& d) { return -d.yaw_acceleration_radps2; };
  limits.insert(limits.end(), {{"a speed", "m/s", "can.max_speed_mps", s.can.max_speed_mps, speed},
                               {"a yaw rate", "rad/s", "can.max_yaw_rate_radps",
                                s.can.max_yaw_rate_radps, yaw_rate},
                               {"an acceleration", "m/s^2", "can.max_acceleration_mps2",
                                s.can.max_acceleration_mps2, faster},
                               {"a deceleration", "m/s^2", "can.max_deceleration_mps2",
                                s.can.max_deceleration_mps2, slower},
                               {"a yaw acceleration", "rad/s^2", "can.max_yaw_acceleration_radps2",
                                s.can.max_yaw_acceleration_radps2, into_turn},
                               {"a yaw deceleration", "rad/s^2", "can.max_yaw_deceleration_radps2",
                                s.can.max_yaw_deceleration_radps2, out_of_turn}});
  return limits;
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

void check_path(const PlannedPath& path, const Scenario& scenario, const std::string& source) {
  const std::vector<Limit> limits = limits_of(scenario);
  const auto steps = path.profile().steps();
  PathPoint last = path.point(steps.front());
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const PathPoint point = path.point(steps[i]);
    const double reach = reach_m(scenario.vehicle, point);
    if (reach > scenario.world.half_extent_m + kTouch_m) {
      refuse(path, steps[i], source,
             fmt::format("the vehicle would be in or beyond a wall: its outline reaches {:.2f} m; "
                         "world.half_extent_m = {}",
                         reach, scenario.world.half_extent_m));
    }
    if (i == 0) continue;
    const Demand d = demand(last, point, steps[i].t_s - steps[i - 1].t_s, scenario.vehicle.track_m);
    last = point;
    for (const Limit& limit : limits) {
      const double value = limit.of(d);
      if (value <= limit.value * (1.0 + kSlack)) continue;
      refuse(path, steps[i], source,
             fmt::format("the path needs {} of {:.3f} {}; {} = {}", limit.what, value, limit.unit,
                         limit.key, limit.value));
    }
  }
}

}  // namespace tether
