#include "controller/tube/tube_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/actuator/actuator_settings.hpp"
#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"

namespace tether {
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
