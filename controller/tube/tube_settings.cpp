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

/// What the floor does is in a tube as a disturbance alone.
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

void check(const Scenario& scenario, const std::string& file) {
  const auto& tube = scenario.get<TubeSettings>();
  if (tube.silence_s <= 0.0) return;
  need_plans(scenario, file);
  need_disturbance(scenario, file);
  const double horizon_s = scenario.get<ControllerSettings>().horizon_s;
  if (tube.silence_s > horizon_s) {
    throw UsageError(
        fmt::format("{}: tube.silence_s = {} must be at most controller.horizon_s = {}: where a "
                    "plan ends, the tube does",
                    file, tube.silence_s, horizon_s));
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
           "guaranteed tube of plans: how long nothing is heard; 0 = none");
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

TubePlan plan_along(const ReferencePath& path, double from_s, double silence_s, double step_s) {
  TubePlan plan{.twists = {}, .step_s = step_s};
  const auto steps = static_cast<std::size_t>(std::max(1.0, std::ceil(silence_s / step_s - 1e-9)));
  for (std::size_t i = 0; i < steps; ++i) {
    const PathPoint p = path.at(from_s + (static_cast<double>(i) + 0.5) * step_s);
    plan.twists.push_back({p.v_mps, p.omega_radps});
  }
  return plan;
}

TubeBounds tube_bounds(const Scenario& scenario, const TubePlan& plan) {
  const auto& v = scenario.get<VehicleSettings>();
  TubeBounds bounds = scenario.get<TubeSettings>().bounds;
  const double larger = (1.0 + bounds.radius) * (1.0 + bounds.track);
  need_speed(plan, v, larger);
  double step_mps = 0.0;
  for (std::size_t i = 1; i < plan.twists.size(); ++i) {
    const Twist &a = plan.twists[i - 1], &b = plan.twists[i];
    step_mps = std::max(step_mps, std::abs(b.v_mps - a.v_mps) +
                                      0.5 * v.track_m * std::abs(b.omega_radps - a.omega_radps));
  }
  bounds.slewing_s = larger * step_mps / v.max_wheel_acceleration_mps2 +
                     2.0 * to_seconds(step_of(scenario.get<WorldSettings>()));
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
  constexpr double kEvery_s = 1.0;
  for (double from_s = std::min(run.settled_from_s, run.duration_s); from_s <= run.duration_s;
       from_s += kEvery_s) {
    const TubePlan plan = plan_along(*path, from_s, silence_s, tube.step_s);
    const std::vector<double> one = reach_tube(plan, tube_bounds(scenario, plan));
    tube.deviation_m.resize(one.size());
    for (std::size_t i = 0; i < one.size(); ++i) {
      tube.deviation_m[i] = std::max(tube.deviation_m[i], one[i]);
    }
  }
  return tube;
}

LongestSilence longest_silence(const Scenario& scenario, double budget_m) {
  const double longest_s = std::min(16.0, scenario.get<ControllerSettings>().horizon_s);
  double looked_s = std::min(0.5, longest_s);
  PathTube tube = path_tube(scenario, looked_s);
  const auto is_within = [&](double m) { return m <= budget_m; };
  while (std::ranges::all_of(tube.deviation_m, is_within) && looked_s < longest_s) {
    tube = path_tube(scenario, looked_s = std::min(longest_s, looked_s * 2.0));
  }
  const auto beyond = std::ranges::find_if_not(tube.deviation_m, is_within);
  const auto steps = static_cast<double>(beyond - tube.deviation_m.begin());
  return {.silence_s = std::max(0.0, steps - 1.0) * tube.step_s,
          .at_once_m = tube.deviation_m.front(),
          .or_longer = beyond == tube.deviation_m.end()};
}

}  // namespace tether
