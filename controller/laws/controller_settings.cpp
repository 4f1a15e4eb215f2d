#include "controller/laws/controller_settings.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "controller/laws/external_command.hpp"
#include "controller/laws/law.hpp"

namespace tether {
namespace {

using Controller = ControllerSettings;

constexpr Range kGain{1e-3, 1e3, false};
constexpr double kMostSteps = 4000.0;  // maximum for a plan_t

void add_law_and_timing(KeyTable<Controller>& t) {
  std::vector<std::string> laws;
  for (const LawKind& kind : law_kinds()) laws.push_back(kind.name);
  t.one_of("law", &Controller::law, laws, "control law: docs/reference/controllers.md");
  t.boolean("external", &Controller::external,
            "no controller is started: the run waits for an external one (docs/reference/time.md)");
  t.text("command", &Controller::command,
         "command that starts an external controller for each run in simulated time; {url}, "
         "{scenario}, {folder}, {seed} and {arm} are filled in (docs/howto/python.md)");
  t.boolean("warm", &Controller::warm,
            "the command serves one run after another and is restarted only after a failure");
  t.boolean("ros2", &Controller::ros2,
            "tether-ros2 is the controller: poses go to ROS 2 nodes, /cmd_vel comes from them "
            "(docs/howto/ros2.md)");
  t.number("patience_s", &Controller::patience_s, {0.1, 86'400.0},
           "maximum time that an external controller may take for one answer, wall clock");
  t.number("tau_s", &Controller::tau_s, kNotNegative, "look-ahead");
  t.choice<Controller::Trigger>(
      "trigger", &Controller::trigger,
      {{"event", Controller::Trigger::event}, {"timer", Controller::Trigger::timer}},
      "event that triggers a command: each pose that arrives, or a timer");
  t.number("rate_hz", &Controller::rate_hz, kRate, "trigger = timer: commands per second");
  t.number(
      "pose_timeout_s", &Controller::pose_timeout_s, kNotNegative,
      "age of the newest pose, or without any the time since t = 0, that stops the vehicle; 0 = "
      "never");
  t.boolean("wrap_heading", &Controller::wrap_heading,
            "heading error is wrapped to (-pi, pi]; false: not wrapped, which may turn the long "
            "way round");
  t.number("derivative_filter_s", &Controller::derivative_filter_s, kNotNegative,
           "time constant of the low-pass before the D terms");
}

void add_sending(KeyTable<Controller>& t) {
  t.choice<Controller::Send>(
      "send", &Controller::send,
      {{"always", Controller::Send::always}, {"changed", Controller::Send::changed}},
      "commands or plans to send: all, or those that differ from the last one sent");
  t.number("send_delta_mps", &Controller::send_delta_mps, kNotNegative,
           "send = changed: a speed off by more than this, of a plan at any time, is sent");
  t.number("send_delta_radps", &Controller::send_delta_radps, kNotNegative,
           "send = changed: a yaw rate off by more than this, of a plan at any time, is sent");
  t.number("send_max_age_s", &Controller::send_max_age_s, kPositive,
           "send = changed: the longest time between two commands or plans that are sent");
}

void add_planning(KeyTable<Controller>& t) {
  t.file("tau_table", &Controller::tau_table,
         "law = pid_adaptive: CSV of look-aheads by network, relative to the scenario file");
  t.number("tau_factor", &Controller::tau_factor, kPositive,
           "law = pid_adaptive: factor on the table's look-aheads, for other gains or rates");
  t.number("horizon_s", &Controller::horizon_s, {0.05, 200.0, false}, "length of a plan");
  t.number("plan_step_ms", &Controller::plan_step_ms, {5.0, 1000.0, false},
           "duration of each twist of a plan; a horizon has at most 4000");
  t.boolean("preload", &Controller::preload, "the first plan is on board before departure");
}

std::vector<ScenarioKey> gains(KeyTable<PidGains> t, const std::string& unit) {
  t.number("p", &PidGains::p, kNotNegative, "P gain");
  t.number("i", &PidGains::i, kNotNegative, "I gain");
  t.number("d", &PidGains::d, kNotNegative, "D gain");
  t.number("limit", &PidGains::limit, kPositive, "saturation of the output, ± " + unit);
  return t.take();
}

void add_feedback_and_model(KeyTable<Controller>& t) {
  t.number("tracking.k_x", TETHER_MEMBER(tracking.k_x), kGain, "gain along the path, 1/s");
  t.number("tracking.k_y", TETHER_MEMBER(tracking.k_y), kGain, "gain across the path, 1/m^2");
  t.number("tracking.k_theta", TETHER_MEMBER(tracking.k_theta), kGain, "gain of the heading, 1/m");
  t.number("tracking.max_lateral_mps2", TETHER_MEMBER(tracking.max_lateral_mps2),
           {0.1, 100.0, false}, "limit of speed times yaw rate while catching up with the path");
  t.optional_number("model.track_m", TETHER_MEMBER(model.track_m), kLength,
                    "track in predictions; not set: the vehicle's");
  t.optional_number("model.max_wheel_acceleration_mps2",
                    TETHER_MEMBER(model.max_wheel_acceleration_mps2), kPositive,
                    "slew rate of rim speeds in predictions; not set: the vehicle's");
}

void add_estimation(KeyTable<Controller>& t) {
  constexpr Range kNoise{1e-6, 100.0, false};
  constexpr Range kDrift{0.0, 100.0, false};
  t.choice<Controller::Estimator>(
      "estimator", &Controller::estimator,
      {{"none", Controller::Estimator::none}, {"ekf", Controller::Estimator::ekf}},
      "pose that laws use: the newest one, or an extended Kalman filter's");
  t.number("ekf.position_noise_m", TETHER_MEMBER(ekf.position_noise_m), kNoise,
           "standard deviation of a pose's noise on x and y that the filter assumes");
  t.number("ekf.yaw_noise_rad", TETHER_MEMBER(ekf.yaw_noise_rad), kNoise,
           "standard deviation of a pose's noise on yaw that the filter assumes");
  t.number("ekf.position_drift_mpsqrts", TETHER_MEMBER(ekf.position_drift_mpsqrts), kDrift,
           "random walk of the vehicle's x and y while its wheels turn, after 1 s: process noise");
  t.number("ekf.yaw_drift_radpsqrts", TETHER_MEMBER(ekf.yaw_drift_radpsqrts), kDrift,
           "random walk of the vehicle's yaw while its wheels turn, after 1 s: process noise");
  t.number("ekf.start_m", TETHER_MEMBER(ekf.start_m), kDrift,
           "standard deviation of the start's x and y");
  t.number("ekf.start_rad", TETHER_MEMBER(ekf.start_rad), kDrift,
           "standard deviation of the start's yaw");
  t.number("ekf.lag_ms", TETHER_MEMBER(ekf.lag_ms), {0.0, 500.0, false},
           "time constant of the drive's rim speeds; with adapt.lag at first");
  t.optional_number("ekf.radius_error", TETHER_MEMBER(ekf.radius_error), {0.0, 0.1, false},
                    "standard deviation of the wheels' radius, relative, adapted or not; not set: "
                    "0.03 if anything is adapted, else 0");
  t.optional_number("ekf.track_error", TETHER_MEMBER(ekf.track_error), {0.0, 0.1, false},
                    "standard deviation of the track, relative, adapted or not; not set: 0.03 if "
                    "anything is adapted, "
                    "else 0");
  t.boolean("adapt.radius", TETHER_MEMBER(adapt.radius), "the filter estimates the wheels' size");
  t.boolean("adapt.track", TETHER_MEMBER(adapt.track), "… the track that the drive believes in");
  t.boolean("adapt.lag", TETHER_MEMBER(adapt.lag), "… the lag of its rim speeds");
  t.boolean("adapt.bias", TETHER_MEMBER(adapt.bias),
            "… a speed and a yaw rate that are added to its own: slopes, drag, slip");
  t.boolean("adapt.clock", &Controller::adapt_clock,
            "by how much the vehicle's clock is ahead, from delays both ways");
  t.number("sensor_latency_ms", &Controller::sensor_latency_ms, {0.0, 1e4, false},
           "share of a pose's age at its arrival that is its sensor's and not the network's");
}

bool is_of_filter(const std::string& key) {
  return key.starts_with("controller.ekf.") || key.starts_with("controller.adapt.");
}

bool uses(const LawKind& law, const std::string& part) {
  return std::any_of(law.keys.begin(), law.keys.end(),
                     [&](const std::string& key) { return part.starts_with(key); });
}

std::string why_no_effect(const Scenario& scenario, const std::string& key) {
  const auto& controller = scenario.get<Controller>();
  const bool none = controller.estimator == Controller::Estimator::none;
  if (none && is_of_filter(key)) return "controller.estimator is \"none\"";
  if (key.starts_with("controller.adapt.") && !kind_of(controller).sends_plans) {
    return fmt::format("controller.law is \"{}\", which sends twists", controller.law);
  }
  if (key == "controller.warm" && controller.command.empty()) {
    return "there is no controller.command";
  }
  if (key == "controller.patience_s" && !controller.is_external()) {
    return "there is neither a controller.command nor controller.external";
  }
  return "";
}

/// Keys that only other laws use are left out, and not those of the law on board (PathFollower).
/// They are no mistake: one file may have what several laws need.
bool left_out(const Scenario& scenario, const ScenarioKey& key) {
  const std::string prefix = "controller.";
  if (!key.name.starts_with(prefix)) return false;
  if (scenario.get<Controller>().estimator == Controller::Estimator::none &&
      key.name == prefix + "estimator") {
    return true;
  }
  if (!why_no_effect(scenario, key.name).empty()) return true;
  if (key.name == prefix + "ros2") return !scenario.get<Controller>().ros2;
  if (key.name == prefix + "send") {
    return scenario.get<Controller>().send == Controller::Send::always;
  }
  const std::string part = key.name.substr(prefix.size());
  const auto& controller = scenario.get<Controller>();
  if (part == "sensor_latency_ms") {
    if (controller.sensor_latency_ms == 0.0) return true;
    if (controller.estimator == Controller::Estimator::ekf) return false;
  }
  const auto& kinds = law_kinds();
  if (scenario.get<AutonomySettings>().enabled && part.starts_with("tracking.")) return false;
  return !uses(kind_of(scenario.get<Controller>()), part) &&
         std::any_of(kinds.begin(), kinds.end(),
                     [&](const LawKind& other) { return uses(other, part); });
}

std::string policies_for_plans() {
  std::vector<std::string> names;
  for (const ActuatorPolicy& policy : actuator_policies()) {
    if (policy.takes_plans) names.push_back(fmt::format("\"{}\"", policy.name));
  }
  return fmt::format("{}", fmt::join(names, " or "));
}

std::string laws_that_drive(bool on_request) {
  std::vector<std::string> names;
  for (const LawKind& law : law_kinds()) {
    if (law.drives_on_request == on_request) names.push_back(fmt::format("\"{}\"", law.name));
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

/// A vehicle that drives by itself needs a remote driver who waits until it asks, any other one who
/// does not.
void check_driver(const Scenario& scenario, const std::string& file) {
  const auto& controller = scenario.get<Controller>();
  const bool on_request = kind_of(controller).drives_on_request;
  const bool by_itself = scenario.get<AutonomySettings>().enabled;
  if (controller.is_external() || on_request == by_itself) return;
  throw UsageError(
      by_itself
          ? fmt::format("{}: controller.law = \"{}\" never takes over a vehicle that drives by "
                        "itself (autonomy.enabled = true): controller.law must be {}, or "
                        "controller.external = true with an external driver",
                        file, controller.law, laws_that_drive(true))
          : fmt::format("{}: controller.law = \"{}\" drives only when a vehicle asks for it, and "
                        "autonomy.enabled is false: it would never move; autonomy.enabled must be "
                        "true, or controller.law one of {}",
                        file, controller.law, laws_that_drive(false)));
}

/// Placeholders of a command; a warm program learns about each run only from the scenario's file.
void check_command(const Controller& controller, const std::string& file) {
  std::vector<std::string> names{"url", "scenario", "folder"};
  if (!controller.warm) names.insert(names.end(), {"seed", "arm"});
  filled_in(controller.command, [&](const std::string& name) {
    if (std::find(names.begin(), names.end(), name) != names.end()) return name;
    throw UsageError(fmt::format("{}: controller.command: {{{}}} must be {{{}}}{}", file, name,
                                 fmt::join(names, "}, {"),
                                 controller.warm ? " with controller.warm = true" : ""));
  });
}

/// {folder}: of the file that has the command.
void fill_in_folder(Scenario& scenario, const ScenarioLevel& level) {
  if (!level.has("controller.command")) return;
  std::string& command = scenario.get<Controller>().command;
  const std::string folder = level.folder.empty() ? "." : level.folder.string();
  command = filled_in(command, [&](const std::string& name) {
    return name == "folder" ? "'" + folder + "'" : "{" + name + "}";
  });
}

void check(const Scenario& scenario, const std::string& file) {
  const auto& controller = scenario.get<Controller>();
  check_command(controller, file);
  if (controller.ros2 && (controller.external || !controller.command.empty())) {
    throw UsageError(fmt::format(
        "{}: controller.ros2 = true does not go with controller.external or controller.command: a "
        "run has one controller",
        file));
  }
  const LawKind& law = kind_of(controller);
  if (law.check != nullptr) law.check(controller, file);
  if (!law.sends_plans) return check_driver(scenario, file);
  if (!kind_of(scenario.get<ActuatorSettings>()).takes_plans) {
    throw UsageError(
        fmt::format("{}: controller.law is one that sends plans, which the vehicle follows with "
                    "actuator.policy = {} only",
                    file, policies_for_plans()));
  }
  if (scenario.get<AutonomySettings>().enabled && !controller.is_external()) {
    throw UsageError(fmt::format(
        "{}: controller.law = \"{}\" plans from the plan in force, which poses do not name with "
        "autonomy.enabled = true; \"detour\" is the law of a remote driver",
        file, controller.law));
  }
  if (controller.horizon_s * 1e3 < controller.plan_step_ms) {
    throw UsageError(
        fmt::format("{}: controller.horizon_s = {} is shorter than a step of "
                    "controller.plan_step_ms = {}",
                    file, controller.horizon_s, controller.plan_step_ms));
  }
  if (controller.horizon_s * 1e3 > controller.plan_step_ms * kMostSteps) {
    throw UsageError(fmt::format(
        "{}: controller.horizon_s = {} has more than {} steps of controller.plan_step_ms = {}",
        file, controller.horizon_s, kMostSteps, controller.plan_step_ms));
  }
}

}  // namespace

ScenarioSection controller_section() {
  KeyTable<Controller> t("controller.");
  add_law_and_timing(t);
  add_sending(t);
  add_planning(t);
  t.append(gains(t.within<PidGains>("v.", &Controller::v), "m/s"));
  t.append(gains(t.within<PidGains>("omega.", &Controller::omega), "rad/s"));
  add_feedback_and_model(t);
  add_estimation(t);
  for (const LawKind& law : law_kinds()) t.append(law.own_keys);
  ScenarioSection section{.defaults = Controller{}, .keys = t.take()};
  section.why_no_effect = why_no_effect;
  section.left_out = left_out;
  const std::string send = "controller.send", always = "always";
  section.switched = {{"controller.rate_hz", {"controller.trigger"}, std::string("event")},
                      {"controller.send_delta_mps", {send}, always},
                      {"controller.send_delta_radps", {send}, always},
                      {"controller.send_max_age_s", {send}, always},
                      {"controller.derivative_filter_s", {"controller.v.d", "controller.omega.d"}}};
  section.end_level = fill_in_folder;
  section.check = check;
  return section;
}

void check_command_has_url(const Controller& controller, const std::string& file) {
  bool has_url = controller.command.empty();
  filled_in(controller.command, [&](const std::string& name) {
    has_url = has_url || name == "url";
    return name;
  });
  if (has_url) return;
  throw UsageError(fmt::format(
      "{}: controller.command = \"{}\" must have {{url}} in it: each run has an LCM network of its "
      "own, and the program learns only so where it is (PROGRAM --url {{url}} --scenario "
      "{{scenario}})",
      file, controller.command));
}

std::vector<PathLimit> controller_path_limits(const Scenario& scenario) {
  const auto& controller = scenario.get<Controller>();
  return {{"a speed", "m/s", "controller.v.limit", controller.v.limit,
           [](const PathDemand& d) { return d.point.v_mps; }},
          {"a yaw rate", "rad/s", "controller.omega.limit", controller.omega.limit,
           [](const PathDemand& d) { return std::abs(d.point.omega_radps); }}};
}

}  // namespace tether
