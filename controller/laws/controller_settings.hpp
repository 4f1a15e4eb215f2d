#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/check.hpp"
#include "common/scenario/own_settings.hpp"
#include "common/scenario/section.hpp"
#include "controller/laws/pose_filter.hpp"

namespace tether {

/// [controller.v] and [controller.omega]: of a PID
struct PidGains {
  double p = 0.0;
  double i = 0.0;
  double d = 0.0;
  double limit = 0.0;  ///< saturation of the output, ±
};

/// [controller.tracking]: the feedback of the tracking laws
/// (controller/laws/tracking_law.hpp).
struct TrackingGains {
  double k_x = 2.5;               ///< 1/s
  double k_y = 0.8;               ///< 1/m²
  double k_theta = 2.0;           ///< 1/m
  double max_lateral_mps2 = 3.0;  ///< v·ω while catching up; that of the path itself may be more
};

/// [controller.model]: the vehicle as predictions see it; what is not set is as the vehicle has it.
struct ModelSettings {
  std::optional<double> track_m;
  std::optional<double> max_wheel_acceleration_mps2;
};

/// [controller]. Which keys a law uses is said in its row (law.hpp).
struct ControllerSettings {
  enum class Trigger { event, timer };
  std::string law = "pid";  ///< the name of one of law_kinds()
  double tau_s = 2.0;       ///< look-ahead τ
  Trigger trigger = Trigger::event;
  double rate_hz = 20.0;        ///< trigger = timer: commands per second
  double pose_timeout_s = 1.0;  ///< a pose older than this stops the vehicle; 0 = never
  /// Which decisions are sent: all, or those that say something new (node/command_sending.hpp).
  enum class Send { always, changed };
  Send send = Send::always;
  double send_delta_mps = 0.05;    ///< by how much a speed is off what was sent
  double send_delta_radps = 0.05;  ///< the same for the yaw rate
  double send_max_age_s = 0.4;     ///< the longest time between two
  bool wrap_heading = true;        ///< law = pid: the heading error is within (−π, π]
  PidGains v{0.495, 0.0, 0.15, 8.0};
  PidGains omega{0.2925, 0.0, 0.16, 2.0};
  double derivative_filter_s = 0.1;  ///< time constant of the filter before the D term
  std::string tau_table;    ///< law = pid_adaptive: its look-aheads; relative to the scenario file
  double tau_factor = 1.0;  ///< law = pid_adaptive: times those of the table
  TrackingGains tracking;
  // Plans of the predictive laws.
  double horizon_s = 20.0;
  double plan_step_ms = 50.0;  ///< each twist of a plan is in force for this long
  Duration plan_step() const { return std::chrono::microseconds{std::llround(plan_step_ms * 1e3)}; }
  /// How many twists a plan has.
  std::size_t plan_steps() const {
    return static_cast<std::size_t>(std::max(1.0, std::round(horizon_s / to_seconds(plan_step()))));
  }
  bool preload = false;   ///< the first plan is on board before departure
  bool external = false;  ///< an external program is the controller, …
  /// … started by this; with {url}, {scenario}, {seed} and {arm} (external_command.hpp)
  std::string command;
  bool warm = false;         ///< it serves one run after another
  bool ros2 = false;         ///< tether-ros2 is the controller: a door to ROS 2 nodes
  double patience_s = 10.0;  ///< maximum time for one answer
  bool is_external() const { return external || !command.empty() || ros2; }
  ModelSettings model;
  /// Source of the law's pose estimate: the newest one as it came, or the filter's.
  enum class Estimator { none, ekf };
  Estimator estimator = Estimator::none;
  PoseFilterSettings ekf;  ///< estimator = ekf, as is what follows
  Adaptation adapt;
  bool adapt_clock = false;        ///< the vehicle's clock is estimated (ClockEstimate)
  double sensor_latency_ms = 0.0;  ///< the sensor's part of a pose's age at its arrival
  OwnSettings own;                 ///< settings of laws with keys that no other law has
};

ScenarioSection controller_section();

/// Throws UsageError unless controller.command, if there is one, has {url}: for runs on a network
/// whose URL is not known before.
void check_command_has_url(const ControllerSettings& controller, const std::string& file);

/// The limits of the controller's output.
std::vector<PathLimit> controller_path_limits(const Scenario& scenario);

}  // namespace tether
