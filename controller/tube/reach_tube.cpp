#include "controller/tube/reach_tube.hpp"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/frames.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"

namespace tether {
namespace {

using Eigen::Vector2d;

constexpr int kDirections = 12;  // number on half a circle; their opposites are used, too
constexpr int kFiner = 5;        // steps of integration in one of the plan

Vector2d turned(const Vector2d& v) { return {-v.y(), v.x()}; }

/// Along the arc of a twist that holds for `dt_s`.
Vector2d arc(double yaw_rad, double v_mps, double omega_radps, double dt_s) {
  const Pose2 end = along_arc({0.0, 0.0, yaw_rad}, v_mps * dt_s, omega_radps * dt_s);
  return {end.x_m, end.y_m};
}

/// A part of a range, by its centre and half its width.
struct Cell {
  double centre = 0.0, half = 0.0;
};

std::vector<Cell> cells(double low, double high, int count) {
  if (!(high > low)) return {{low, 0.0}};
  const double half = 0.5 * (high - low) / count;
  std::vector<Cell> all;
  for (int i = 0; i < count; ++i) all.push_back({low + (2 * i + 1) * half, half});
  return all;
}

/// A change of the twist, `at_s` after the silence began.
struct Jump {
  double at_s;
  Twist by;
};

std::vector<Jump> jumps_of(const TubePlan& plan) {
  std::vector<Jump> all;
  for (std::size_t i = 1; i < plan.twists.size(); ++i) {
    const Twist &from = plan.twists[i - 1], &to = plan.twists[i];
    all.push_back({(static_cast<double>(i) - static_cast<double>(plan.before)) * plan.step_s,
                   {to.v_mps - from.v_mps, to.omega_radps - from.omega_radps}});
  }
  return all;
}

/// Integral of the difference that a low-pass still has from a unit jump `ago_s` ago.
double yet_to_do_s(double ago_s, double lag_s) {
  if (ago_s < 0.0) return lag_s - ago_s;
  return lag_s > 0.0 ? lag_s * std::exp(-ago_s / lag_s) : 0.0;
}

/// Share of that jump that the low-pass has not followed yet.
double share_left(double ago_s, double lag_s) {
  if (ago_s <= 0.0) return 1.0;
  return lag_s > 0.0 ? std::exp(-ago_s / lag_s) : 0.0;
}

/// The twist that a drive with a clock and a lag is at, in the middle of each fine step.
std::vector<Twist> followed(const TubePlan& plan, const std::vector<Jump>& jumps, double clock_s,
                            double lag_s) {
  const double dt_s = plan.step_s / kFiner;
  const double keep = lag_s > 0.0 ? std::exp(-dt_s / lag_s) : 0.0;
  Twist is = plan.twists.front();
  for (const Jump& jump : jumps) {
    const double done = 1.0 - share_left(clock_s - jump.at_s, lag_s);
    is = {is.v_mps + done * jump.by.v_mps, is.omega_radps + done * jump.by.omega_radps};
  }
  std::vector<Twist> all;
  for (std::size_t k = 0; k < plan.steps() * kFiner; ++k) {
    const Twist& to = plan.at((static_cast<double>(k) + 0.5) * dt_s + clock_s);
    is = {to.v_mps + keep * (is.v_mps - to.v_mps),
          to.omega_radps + keep * (is.omega_radps - to.omega_radps)};
    all.push_back(is);
  }
  return all;
}

/// How far way and heading can be from those of a cell's centre up to the end of each of the plan's
/// steps, by shifts in time, lags and what was left: m and rad, as a twist in force for a second.
std::vector<Twist> shifts(const TubePlan& plan, const std::vector<Jump>& jumps,
                          const TubeBounds& bounds, const Cell& clock, const Cell& lag) {
  const double slow_s = lag.centre + lag.half, fast_s = std::max(0.0, lag.centre - lag.half);
  const double fine_s = plan.step_s / kFiner;  // for switching within one
  Twist sum{bounds.left_mps * (slow_s + bounds.slewing_s),
            bounds.left_radps * (slow_s + bounds.slewing_s)};
  std::vector<Twist> all;
  auto next = jumps.begin();
  for (std::size_t i = 1; i <= plan.steps(); ++i) {
    const double reached_s = static_cast<double>(i) * plan.step_s + bounds.clock_s + fine_s;
    for (; next != jumps.end() && next->at_s < reached_s; ++next) {
      const double ago_s = clock.centre - next->at_s;
      // Earlier plans sampled the path at other times, each change at most a step from here.
      const bool past = next->at_s <= 0.0;
      const double late_s =
          past ? std::max(clock.centre, ago_s - plan.step_s) - clock.half : ago_s - clock.half;
      const double early_s = ago_s + clock.half + (past ? plan.step_s : 0.0);
      const double middle_s = yet_to_do_s(ago_s, lag.centre);
      const double off_s = std::max(yet_to_do_s(late_s, slow_s) - middle_s,
                                    middle_s - yet_to_do_s(early_s, fast_s)) +
                           bounds.slewing_s * share_left(late_s - bounds.slewing_s, slow_s) +
                           fine_s * share_left(late_s - fine_s, slow_s);
      sum.v_mps += off_s * std::abs(next->by.v_mps);
      sum.omega_radps += off_s * std::abs(next->by.omega_radps);
    }
    all.push_back(sum);
  }
  return all;
}

struct CellOfBox {
  Cell radius, track;
};

/// Set reachable from one cell, during its integration.
class Reach {
 public:
  Reach(const TubePlan& plan, const TubeBounds& bounds, const CellOfBox& cell,
        const std::vector<Twist>& followed)
      : b_(bounds), cell_(cell), followed_(followed), dt_s_(plan.step_s / kFiner) {
    larger_ = 1.0 + cell.radius.centre;
    wider_ = 1.0 + cell.track.centre;
    for (int i = 0; i < kDirections; ++i) {
      const double angle = std::numbers::pi * i / kDirections;
      directions_[static_cast<std::size_t>(i)] = {std::cos(angle), std::sin(angle)};
    }
  }

  /// `shift`: shifts() up to the end of this fine step.
  void step(std::size_t k, const Twist& shift) {
    const Twist& w = followed_[k];
    const double v = larger_ * w.v_mps, omega = larger_ * wider_ * w.omega_radps;
    const Vector2d moved = arc(yaw_rad_, v, omega, dt_s_);
    const double speed_m = std::abs(v) * dt_s_;
    const double most_larger = larger_ + cell_.radius.half, most_wider = wider_ + cell_.track.half;
    const double turned_rad = std::abs(swept_rad_) + 0.5 * std::abs(w.omega_radps) * dt_s_;
    // Headings: linear parts, those of shifts, and of second order.
    const double of_radius = cell_.radius.half * wider_, of_track = cell_.track.half * larger_;
    const double shifted_rad = shift.omega_radps * most_larger * most_wider;
    const double second_rad = cell_.radius.half * cell_.track.half * turned_rad;
    const double time_s = (static_cast<double>(k) + 1.0) * dt_s_;
    const double heading_rad = b_.start_rad + (of_radius + of_track) * turned_rad + shifted_rad +
                               second_rad + b_.yaw_radps * time_s;
    const double nu = cell_.radius.half * std::abs(w.v_mps) + b_.speed_mps;
    ball_m_ += speed_m * (shifted_rad + second_rad + 0.5 * heading_rad * heading_rad) +
               nu * dt_s_ * heading_rad;
    shifted_m_ = shift.v_mps * most_larger * (1.0 + heading_rad);
    const double middle_rad = swept_rad_ + 0.5 * w.omega_radps * dt_s_;
    by_radius_ += cell_.radius.half / larger_ * moved + of_radius * middle_rad * turned(moved);
    by_track_ += of_track * middle_rad * turned(moved);
    for (std::size_t i = 0; i < directions_.size(); ++i) {
      along_m_[i] += b_.speed_mps * std::abs(moved_direction(moved).dot(directions_[i])) * dt_s_;
    }
    // Within a fine step the direction turns by this much.
    ball_m_ += b_.speed_mps * dt_s_ * 0.5 * std::abs(omega) * dt_s_;
    swept_rad_ += w.omega_radps * dt_s_;
    yaw_rad_ += omega * dt_s_;
    place_ += moved;
    lateral_mps2_ = std::max(lateral_mps2_, std::abs(v * omega));
    if ((k + 1) % kFiner == 0) places_.push_back(place_);
  }

  /// The farthest from `planned` that it can be now.
  double farthest_m(const Vector2d& planned) const {
    const Vector2d off = place_ - planned, by_heading = b_.start_rad * turned(place_);
    double most = 0.0;
    for (std::size_t i = 0; i < directions_.size(); ++i) {
      const Vector2d& u = directions_[i];
      double support = std::abs(off.dot(u)) + along_m_[i] + std::abs(by_heading.dot(u)) +
                       std::abs(by_radius_.dot(u)) + std::abs(by_track_.dot(u));
      if (b_.yaw_radps > 0.0) support += b_.yaw_radps * yaw_support(u);
      most = std::max(most, support);
    }
    return most / std::cos(0.5 * std::numbers::pi / kDirections) + ball_m_ + shifted_m_ +
           b_.start_m;
  }

 private:
  Vector2d moved_direction(const Vector2d& moved) const {
    const double length = moved.norm();
    return length > 0.0 ? Vector2d(moved / length)
                        : Vector2d(std::cos(yaw_rad_), std::sin(yaw_rad_));
  }

  /// Support function for a yaw rate of 1 rad/s whose sign may change: what turns at s moves all
  /// that comes after. Between two places the way bulges by no more than |v ω| Δ²/8.
  double yaw_support(const Vector2d& u) const {
    const double step_s = kFiner * dt_s_;
    const double now = turned(place_).dot(u), bulge_m = 0.125 * lateral_mps2_ * step_s * step_s;
    double before = 0.0, integral = 0.0;
    for (const Vector2d& place : places_) {
      const double at = turned(place).dot(u);
      integral += (std::max(std::abs(now - at), std::abs(now - before)) + bulge_m) * step_s;
      before = at;
    }
    return integral;
  }

  const TubeBounds& b_;
  const CellOfBox& cell_;
  const std::vector<Twist>& followed_;
  double dt_s_, larger_, wider_;
  std::array<Vector2d, kDirections> directions_;
  std::array<double, kDirections> along_m_{};
  Vector2d place_ = Vector2d::Zero(), by_radius_ = Vector2d::Zero(), by_track_ = Vector2d::Zero();
  double yaw_rad_ = 0.0, swept_rad_ = 0.0;
  double ball_m_ = 0.0, shifted_m_ = 0.0;
  double lateral_mps2_ = 0.0;  // greatest |v ω|, m/s²
  std::vector<Vector2d> places_;
};

}  // namespace

const Twist& TubePlan::at(double t_s) const {
  const auto i =
      static_cast<std::ptrdiff_t>(std::floor(t_s / step_s)) + static_cast<std::ptrdiff_t>(before);
  const auto last = static_cast<std::ptrdiff_t>(twists.size()) - 1;
  return twists[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(i, 0, last))];
}

std::vector<Pose2> planned(const TubePlan& plan) {
  std::vector<Pose2> poses{Pose2{}};
  for (std::size_t i = plan.before; i < plan.before + plan.steps(); ++i) {
    const Twist& u = plan.twists[i];
    poses.push_back(along_arc(poses.back(), u.v_mps * plan.step_s, u.omega_radps * plan.step_s));
  }
  return poses;
}

std::vector<double> reach_tube(const TubePlan& plan, const TubeBounds& bounds) {
  constexpr int kShares = 3, kTimes = 7;
  const std::vector<Pose2> to = planned(plan);
  const std::vector<Jump> jumps = jumps_of(plan);
  std::vector<double> tube(to.size(), bounds.start_m);
  for (const Cell& clock : cells(-bounds.clock_s, bounds.clock_s, kTimes)) {
    for (const Cell& lag : cells(0.0, bounds.lag_s, kTimes)) {
      const std::vector<Twist> twists = followed(plan, jumps, clock.centre, lag.centre);
      const std::vector<Twist> shift = shifts(plan, jumps, bounds, clock, lag);
      for (const Cell& radius : cells(-bounds.radius, bounds.radius, kShares)) {
        for (const Cell& track : cells(-bounds.track, bounds.track, kShares)) {
          const CellOfBox cell{radius, track};
          Reach reach(plan, bounds, cell, twists);
          for (std::size_t k = 0; k < twists.size(); ++k) {
            reach.step(k, shift[k / kFiner]);
            if ((k + 1) % kFiner != 0) continue;
            const std::size_t i = (k + 1) / kFiner;
            tube[i] = std::max(tube[i], reach.farthest_m({to[i].x_m, to[i].y_m}));
          }
        }
      }
    }
  }
  return tube;
}

namespace {

void need_plans(const Scenario& scenario, const std::string& asked) {
  const std::string& policy = scenario.get<ActuatorSettings>().policy;
  if (policy == "horizon") return;
  throw UsageError(
      fmt::format("{}: actuator.policy = \"{}\" must be \"horizon\", with a law that plans, for a "
                  "tube (tube.silence_s, --budget): what holds its last command is not bounded in "
                  "a silence",
                  asked, policy));
}

/// Wheels that cannot turn as fast as the plan asks are not in the tube.
void need_speed(const TubePlan& plan, const VehicleSettings& v, double larger) {
  double asked_mps = 0.0;
  for (const Twist& u : plan.twists) {
    asked_mps = std::max(asked_mps, std::abs(u.v_mps) + 0.5 * v.track_m * std::abs(u.omega_radps));
  }
  if (asked_mps * larger <= v.max_wheel_speed_mps) return;
  throw UsageError(
      fmt::format("tube: vehicle.max_wheel_speed_mps = {} must be at least {:.3f}, which the path "
                  "asks of the wheels, or the tube is no bound",
                  v.max_wheel_speed_mps, asked_mps * larger));
}

/// The floor enters a tube only as a disturbance.
void need_disturbance(const Scenario& scenario, const std::string& asked) {
  const auto& v = scenario.get<VehicleSettings>();
  const auto& world = scenario.get<WorldSettings>();
  const auto& bounds = scenario.get<TubeSettings>().bounds;
  const bool yields = v.plant == VehicleSettings::Plant::ode &&
                      (v.tyre != VehicleConfig::Tyre::rigid || world.slope_x != 0.0 ||
                       world.slope_y != 0.0 || world.bump_spacing_m > 0.0);
  if (!yields || (bounds.speed_mps > 0.0 && bounds.yaw_radps > 0.0)) return;
  throw UsageError(
      fmt::format("{}: tube.speed_mps and tube.yaw_radps must be above 0 with tyres that slip, "
                  "slopes or bumps, or the tube is no bound",
                  asked));
}

/// A clock that is ahead comes to the end of a plan before its silence does.
double longest_s(const Scenario& scenario) {
  return scenario.get<ControllerSettings>().horizon_s - scenario.get<TubeSettings>().bounds.clock_s;
}

/// How long it takes wheels at most to have followed: a queue, into which each change of the twist
/// brings what a rim has to change by, and which the rim's acceleration empties.
double slewing_s(const TubePlan& plan, const VehicleSettings& v, double left_mps) {
  const double done_mps = v.max_wheel_acceleration_mps2 * plan.step_s;
  double waiting_mps = 0.0, most_mps = left_mps;
  for (std::size_t i = 1; i < plan.twists.size(); ++i) {
    const Twist &a = plan.twists[i - 1], &b = plan.twists[i];
    if (i == plan.before) waiting_mps += left_mps;
    waiting_mps = std::max(0.0, waiting_mps - done_mps) + std::abs(b.v_mps - a.v_mps) +
                  0.5 * v.track_m * std::abs(b.omega_radps - a.omega_radps);
    most_mps = std::max(most_mps, waiting_mps);
  }
  return most_mps / v.max_wheel_acceleration_mps2;
}

constexpr double kLongestSlewing_s = 2.0;

void check(const Scenario& scenario, const std::string& file) {
  const auto& tube = scenario.get<TubeSettings>();
  if (tube.silence_s <= 0.0) return;
  need_plans(scenario, file);
  need_disturbance(scenario, file);
  if (tube.silence_s > longest_s(scenario)) {
    throw UsageError(fmt::format(
        "{}: tube.silence_s = {} must be at most controller.horizon_s = {} less "
        "tube.clock_s = {}: where a plan ends, the tube does",
        file, tube.silence_s, scenario.get<ControllerSettings>().horizon_s, tube.bounds.clock_s));
  }
  const auto& v = scenario.get<VehicleSettings>();
  const auto within = [&](const char* key, double is, const char* bound, double most) {
    if (std::abs(is) <= most) return;
    throw UsageError(
        fmt::format("{}: vehicle.{} = {} must be within ±tube.{} = {}, or the tube is "
                    "no bound",
                    file, key, is, bound, most));
  };
  within("radius_error", v.radius_error, "radius", tube.bounds.radius);
  within("track_error", v.track_error, "track", tube.bounds.track);
  within("actuator_lag_ms", v.actuator_lag_ms, "lag_s · 1000", 1e3 * tube.bounds.lag_s);
  within("clock_offset_ms", v.clock_offset_ms, "clock_s · 1000", 1e3 * tube.bounds.clock_s);
}

}  // namespace

ScenarioSection tube_section() {
  using Tube = TubeSettings;
  KeyTable<Tube> t("tube.");
  t.number("silence_s", &Tube::silence_s, {0.0, 60.0, false},
           "guaranteed tube of plans: duration of the silence; 0 = no tube");
  t.number("radius", TETHER_MEMBER(bounds.radius), {0.0, 0.5, false},
           "greatest |vehicle.radius_error|");
  t.number("track", TETHER_MEMBER(bounds.track), {0.0, 0.5, false},
           "greatest |vehicle.track_error|");
  t.number("lag_s", TETHER_MEMBER(bounds.lag_s), {0.0, 10.0, false},
           "greatest vehicle.actuator_lag_ms, in s");
  t.number("clock_s", TETHER_MEMBER(bounds.clock_s), {0.0, 10.0, false},
           "greatest |vehicle.clock_offset_ms|, in s");
  t.number("speed_mps", TETHER_MEMBER(bounds.speed_mps), {0.0, 10.0, false},
           "greatest disturbance of the speed");
  t.number("yaw_radps", TETHER_MEMBER(bounds.yaw_radps), {0.0, 10.0, false},
           "greatest disturbance of the yaw rate");
  t.number("start_m", TETHER_MEMBER(bounds.start_m), {0.0, 100.0, false},
           "maximum distance from the plan when silence begins");
  t.number("start_rad", TETHER_MEMBER(bounds.start_rad), {0.0, 1.0, false},
           "maximum heading error when silence begins");
  t.number(
      "left_mps", TETHER_MEMBER(bounds.left_mps), {0.0, 10.0, false},
      "largest difference between speeds of earlier plans and the path's, which lagging wheels "
      "still have when silence begins");
  t.number("left_radps", TETHER_MEMBER(bounds.left_radps), {0.0, 10.0, false},
           "largest difference between yaw rates of earlier plans and the path's, in the same way "
           "as tube.left_mps");
  ScenarioSection section{.defaults = Tube{}, .keys = t.take()};
  for (const ScenarioKey& key : section.keys) {
    if (key.name != "tube.silence_s") section.switched.push_back({key.name, {"tube.silence_s"}});
  }
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name == "tube.silence_s" && scenario.get<Tube>().silence_s == 0.0;
  };
  section.check = check;
  return section;
}

double PathTube::after_m(double silence_s) const {
  const auto i = static_cast<std::size_t>(std::ceil(silence_s / step_s - 1e-9));
  return *std::max_element(
      deviation_m.begin(),
      deviation_m.begin() + static_cast<std::ptrdiff_t>(std::min(i, deviation_m.size() - 1)) + 1);
}

TubePlan plan_along(const Scenario& scenario, const ReferencePath& path, double from_s,
                    double silence_s) {
  constexpr double kLags = 16.0;  // after which e⁻¹⁶ is left
  const TubeBounds& bounds = scenario.get<TubeSettings>().bounds;
  TubePlan plan;
  plan.step_s = to_seconds(scenario.get<ControllerSettings>().plan_step());
  const auto steps = [&](double s) {
    return static_cast<std::size_t>(std::max(1.0, std::ceil(s / plan.step_s - 1e-9)));
  };
  plan.before = steps(kLags * bounds.lag_s + kLongestSlewing_s + bounds.clock_s);
  plan.after = steps(bounds.clock_s);
  const std::size_t all = plan.before + steps(silence_s) + plan.after;
  for (std::size_t i = 0; i < all; ++i) {
    const double at = static_cast<double>(i) - static_cast<double>(plan.before) + 0.5;
    const PathPoint p = path.at(std::max(0.0, from_s + at * plan.step_s));
    plan.twists.push_back({p.v_mps, p.omega_radps});
  }
  return plan;
}

TubeBounds tube_bounds(const Scenario& scenario, const TubePlan& plan) {
  const auto& v = scenario.get<VehicleSettings>();
  TubeBounds bounds = scenario.get<TubeSettings>().bounds;
  const double larger = (1.0 + bounds.radius) * (1.0 + bounds.track);
  need_speed(plan, v, larger);
  const double slewing =
      larger * slewing_s(plan, v, bounds.left_mps + 0.5 * v.track_m * bounds.left_radps);
  if (slewing > kLongestSlewing_s) {
    throw UsageError(
        fmt::format("tube: vehicle.max_wheel_acceleration_mps2 = {} must be larger: the wheels are "
                    "up to {:.3f} s behind the path, and the tube holds for {:g} s at most",
                    v.max_wheel_acceleration_mps2, slewing, kLongestSlewing_s));
  }
  const double step_s = to_seconds(step_of(scenario.get<WorldSettings>()));
  bounds.slewing_s = slewing + 2.0 * step_s;
  // Drives reckon their low-pass by backward Euler, which is slower by half a step.
  if (bounds.lag_s > 0.0) bounds.lag_s += step_s;
  return bounds;
}

std::optional<double> tube_m(const Scenario& scenario) {
  const double silence_s = scenario.get<TubeSettings>().silence_s;
  if (silence_s <= 0.0) return std::nullopt;
  return path_tube(scenario, silence_s).after_m(silence_s);
}

PathTube path_tube(const Scenario& scenario, double silence_s) {
  need_plans(scenario, "tube");
  const auto path = make_path(scenario.get<PathSettings>());
  const auto& run = scenario.get<RunSettings>();
  PathTube tube;
  tube.step_s = to_seconds(scenario.get<ControllerSettings>().plan_step());
  constexpr double kEvery_s = 0.1;  // budgets come out as with every 0.05 s; with 1 s, 13 % longer
  for (double from_s = std::min(run.settled_from_s, run.duration_s); from_s <= run.duration_s;
       from_s += kEvery_s) {
    const TubePlan plan = plan_along(scenario, *path, from_s, silence_s);
    const std::vector<double> one = reach_tube(plan, tube_bounds(scenario, plan));
    tube.deviation_m.resize(one.size());
    for (std::size_t i = 0; i < one.size(); ++i) {
      tube.deviation_m[i] = std::max(tube.deviation_m[i], one[i]);
    }
  }
  return tube;
}

LongestSilence longest_silence(const Scenario& scenario, double budget_m) {
  const double most_s = std::min(16.0, longest_s(scenario));
  double looked_s = std::min(0.5, most_s);
  PathTube tube = path_tube(scenario, looked_s);
  const auto is_within = [&](double m) { return m <= budget_m; };
  while (std::ranges::all_of(tube.deviation_m, is_within) && looked_s < most_s) {
    tube = path_tube(scenario, looked_s = std::min(most_s, looked_s * 2.0));
  }
  const auto beyond = std::ranges::find_if_not(tube.deviation_m, is_within);
  const auto steps = static_cast<double>(beyond - tube.deviation_m.begin());
  return {.silence_s = std::max(0.0, steps - 1.0) * tube.step_s,
          .at_once_m = tube.deviation_m.front(),
          .or_longer = beyond == tube.deviation_m.end()};
}

}  // namespace tether
