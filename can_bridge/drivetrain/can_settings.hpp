#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/path/check.hpp"
#include "common/scenario/section.hpp"

namespace tether {

/// [can], with vehicle.drivetrain = can: the bridge, its limits and time-outs, the bus
/// (docs/reference/drivetrain.md).
struct CanSettings {
  enum class Arm { once, never };
  enum class Wheels { sim, model };
  enum class Inject {
    none,
    fault,
    reboot,
    silence,
    sdo_abort,
    encoder_freeze,
    wheel_slip,
    safety_input,
  };

  std::string drivetrain_file;      ///< drives on the bus; relative to the scenario file
  std::string interface = "vcan0";  ///< live runs: SocketCAN interface
  double bit_rate_bps = 500'000;    ///< virtual runs: of the bus; reports: for the bus load
  Wheels wheels = Wheels::sim;      ///< wheels that emulated drives turn
  bool emulate_drives = true;       ///< live runs start tether-can-drive
  /// Who presses "arm": once = the run itself, as soon as the drivetrain is ready; never = an
  /// operator (`tether can arm`).
  Arm arm = Arm::once;
  /// Hold-to-run: longest time between the operator's signals that he holds; 0: not required.
  double operator_timeout_ms = 0.0;
  std::string estop_file;  ///< remembers a latched e-stop; "": see docs/reference/drivetrain.md
  /// File that `tether can commission` wrote, for arming to compare; "": the same.
  std::string commission_record;
  double cycle_ms = 20.0;   ///< period of the control loop: SYNC and setpoints
  double stale_ms = 200.0;  ///< age of the newest command above which the vehicle ramps to zero
  /// Age of the newest command above which the bridge makes a quick stop and disarms.
  double disarm_ms = 500.0;
  double max_stale_m = 0.5;  ///< or older than the vehicle takes for this way: ramp to zero
  double max_blind_s = 1.0;  ///< plans drive on for at most this time ...
  double max_blind_m = 1.0;  ///< ... and distance without a fresh pose
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
  std::int64_t inject_node = 0;  ///< CANopen node id, or number of the safety input; 0: all
  double inject_at_s = 10.0;
  double inject_value = 0.0;  ///< see drive_fault_t
};

ScenarioSection can_section();

/// Limits of the bridge on commands; none without drives on CAN.
std::vector<PathLimit> can_path_limits(const Scenario& scenario);

}  // namespace tether
