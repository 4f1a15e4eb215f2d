#pragma once

#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/figure_eight.hpp"
#include "common/path/limits.hpp"
#include "common/scenario/control_laws.hpp"
#include "common/scenario/link_config.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// All that a run depends on. Defaults are here and nowhere else; scenario_keys.cpp names the keys,
/// their units and ranges; scenarios/paper.toml is the paper's setting, commented.
struct Scenario {
  struct Run {
    double duration_s = 62.0;
    /// The loop lives this long before the path starts at t = 0: poses flow, the vehicle stands,
    /// the controller commands zero, drives start up and are armed. 0: everything starts at once.
    double lead_s = 0.0;
    std::uint64_t seed = 1;
    double truth_rate_hz = 50.0;   ///< SIM/TRUTH messages and rows of trajectory.csv
    double report_period_s = 1.0;  ///< NET/… and …/COUNTERS
  };
  struct Vehicle : VehicleConfig {
    enum class Plant { ode, kinematic };
    enum class Drivetrain { direct, can };
    Plant plant = Plant::ode;
    /// As the key has it.
    const char* plant_name() const { return plant == Plant::kinematic ? "kinematic" : "ode"; }
    /// What turns commands into wheel speeds: the simulator itself, or drives on a CAN bus.
    Drivetrain drivetrain = Drivetrain::direct;
    std::string name = "AGV";  ///< first part of its LCM channels
    // What nobody told the vehicle, nor the controller: sim/plant/drive_errors.hpp. With drives on
    // CAN they have no effect.
    double radius_error = 0.0;     ///< share by which the wheels are larger than it believes
    double track_error = 0.0;      ///< share by which it believes in too wide a track
    double actuator_lag_ms = 0.0;  ///< time constant of its rim speeds
    double clock_offset_ms =
        0.0;  ///< its clock is ahead of the run's, and the controller's, by this
  };
  struct Sensor {
    double rate_hz = 20.0;
    double position_noise_m = 0.0;        ///< standard deviation, each axis, white
    double yaw_noise_rad = 0.0;           ///< standard deviation, white
    double position_drift_mpsqrts = 0.0;  ///< random walk of each axis, as odometry has it:
    double yaw_drift_radpsqrts = 0.0;     ///< standard deviation after 1 s; it grows with √t
    double latency_ms = 0.0;              ///< from measurement to publication
  };
  struct Path {
    enum class Kind { figure_eight, circle, line, rounded_rectangle, csv };
    Kind kind = Kind::figure_eight;
    FigureEight::Config figure_eight;
    std::string csv;               ///< kind = csv: waypoints; relative to the scenario file
    double radius_m = 8.0;         ///< circle
    double length_m = 15.0;        ///< line; rounded_rectangle, along the start's heading
    double width_m = 10.0;         ///< rounded_rectangle, across the start's heading
    double corner_radius_m = 2.0;  ///< rounded_rectangle, the least
    bool clockwise = false;        ///< circle, rounded_rectangle
    Pose2 start;                   ///< circle, line, rounded_rectangle
    PathLimits limits;             ///< all but the figure eight
  };
  struct Gains {
    double p = 0.0;
    double i = 0.0;
    double d = 0.0;
    double limit = 0.0;  ///< saturation of the output, ±
  };
  /// The feedback of the tracking laws (controller/laws/tracking_feedback.hpp).
  struct Tracking {
    double k_x = 2.5;               ///< 1/s
    double k_y = 0.8;               ///< 1/m²
    double k_theta = 2.0;           ///< 1/m
    double max_lateral_mps2 = 3.0;  ///< v·ω of catching up; the path's own may be more
  };
  /// What predictions take the vehicle for; not set: as it is.
  struct Model {
    std::optional<double> track_m;
    std::optional<double> max_wheel_acceleration_mps2;
  };
  struct Controller {
    using Law = ControlLaw;
    enum class Trigger { event, timer };
    Law law = Law::pid;
    double tau_s = 2.0;  ///< look-ahead τ
    Trigger trigger = Trigger::event;
    double rate_hz = 20.0;        ///< trigger = timer: commands per second
    double pose_timeout_s = 1.0;  ///< a pose older than this stops the vehicle; 0 = never
    bool wrap_heading = true;     ///< law = pid: the heading error is within (−π, π]
    Gains v{0.495, 0.0, 0.15, 8.0};
    Gains omega{0.2925, 0.0, 0.16, 2.0};
    double derivative_filter_s = 0.1;  ///< time constant of the filter before the D term
    std::string tau_table;  ///< law = pid_adaptive: its look-aheads; relative to the scenario file
    Tracking tracking;
    // Plans of the predictive laws.
    double horizon_s = 20.0;
    double plan_step_ms = 50.0;  ///< each twist of a plan is in force for this long
    bool preload = false;        ///< the first plan is on board before departure
    bool external = false;       ///< somebody else's program is the controller
    Model model;
  };
  struct Actuator {
    enum class Policy { hold, zero, ramp, decay, horizon };
    Policy policy = Policy::hold;
    double timeout_s = 0.5;  ///< all but hold: without a new twist for this long, stop
    double decay_s = 0.5;    ///< policy = decay: time constant of the stop
    // policy = ramp, horizon: of the stop; the wheels' acceleration limit holds, too.
    double deceleration_mps2 = 1.5;
    double yaw_deceleration_radps2 = 3.0;
  };
  struct Channel {
    bool shared_state = false;  ///< both directions follow the uplink's state process
    LinkConfig uplink;
    LinkConfig downlink;
    std::map<std::string, LinkConfig> links;  ///< [channel.links.NAME]: for rules of tether-netem

    /// Other settings from some time on: common/scenario/channel_settings.hpp.
    struct Change {
      double at_s = 0.0;
      std::vector<std::string> settings;  ///< "KEY=VALUE", keys without "channel."
    };
    std::vector<Change> changes;  ///< in order of time

    /// Calls f(name, link) for each link: "uplink", "downlink", "links.NAME". Their keys begin with
    /// "channel.<name>.".
    template <class Function>
    void for_each_link(Function f) {
      for_each_link(*this, f);
    }
    template <class Function>
    void for_each_link(Function f) const {
      for_each_link(*this, f);
    }

   private:
    static void for_each_link(auto& channel, auto& f) {
      f(std::string("uplink"), channel.uplink);
      f(std::string("downlink"), channel.downlink);
      for (auto& [name, link] : channel.links) f("links." + name, link);
    }
  };

  /// vehicle.drivetrain = can: the bridge, its limits and time-outs, the bus (docs/drivetrain.md).
  struct Can {
    enum class Arm { once, never };
    enum class Wheels { sim, model };
    enum class Inject { none, fault, reboot, silence, sdo_abort, encoder_freeze, wheel_slip };

    std::string drivetrain_file;      ///< what is on the bus; relative to the scenario file
    std::string interface = "vcan0";  ///< live runs: SocketCAN interface
    double bit_rate_bps = 500'000;    ///< virtual runs: of the bus; reports: for the bus load
    Wheels wheels = Wheels::sim;      ///< what emulated drives turn
    bool emulate_drives = true;       ///< live runs start tether-can-drive
    /// Who presses "arm": once = the run itself, as soon as the drivetrain is ready; never = an
    /// operator (`tether can arm`).
    Arm arm = Arm::once;
    double coupling_ms = 5.0;  ///< between messages of emulated drives and simulated wheels
    double cycle_ms = 20.0;    ///< of the control loop: SYNC and setpoints
    double stale_ms = 200.0;   ///< a command older than this: ramp to zero
    double disarm_ms = 500.0;  ///< a command older than this: quick stop and disarm
    double max_speed_mps = 3.0;
    double max_reverse_mps = 3.0;
    double max_yaw_rate_radps = 2.0;
    double max_acceleration_mps2 = 1.0;
    double max_deceleration_mps2 = 1.5;  ///< never below the acceleration
    double max_yaw_acceleration_radps2 = 2.0;
    double max_yaw_deceleration_radps2 = 3.0;  ///< never below the acceleration
    double max_jerk_mps3 = 30.0;
    double max_yaw_jerk_radps3 = 60.0;
    // Emulated drives: one fault at a given time, for sweeps of the safety logic.
    Inject inject = Inject::none;
    std::int64_t inject_node = 0;  ///< CANopen node id; 0: all
    double inject_at_s = 10.0;
    double inject_value = 0.0;  ///< see drive_fault_t
  };

  Run run;
  WorldConfig world;
  Vehicle vehicle;
  Sensor sensor;
  Path path;
  Controller controller;
  Actuator actuator;
  Can can;
  Channel channel;
};

/// The earliest time stamp that is of this run, if clocks do not agree.
inline Instant earliest_stamp(const Scenario& scenario) {
  return kStart -
         from_seconds(scenario.run.lead_s + std::abs(scenario.vehicle.clock_offset_ms) * 1e-3);
}

/// Reads a scenario file over the defaults, then applies `overrides` ("key=value", in TOML's
/// notation; quotes around strings may be left out; channel.X means channel.uplink.X and
/// channel.downlink.X; channel.links.NAME.X makes the link where there is none) in order. Each of
/// channel.change is checked against the settings that are in force by then. Throws UsageError that
/// names file, line, key and what is allowed.
Scenario load_scenario(const std::string& file, const std::vector<std::string>& overrides);

/// The same from text; `name` stands in for the file in messages.
Scenario parse_scenario(const std::string& toml, const std::string& name,
                        const std::vector<std::string>& overrides = {});

/// The resolved scenario as TOML: every key that has an effect, and reading it gives the same run
/// again.
std::string to_toml(const Scenario& scenario);

/// A table of all keys with their defaults, allowed values and meaning, for people.
std::string describe_scenario_keys();

}  // namespace tether
