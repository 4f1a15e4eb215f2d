#pragma once

#include <cstdint>
#include <memory>

#include "common/diff_drive.hpp"
#include "common/pose.hpp"
#include "common/time.hpp"
#include "common/vehicle_config.hpp"

namespace tether {

/// The truth about the vehicle after a step.
struct VehicleState {
  Pose2 pose;                          ///< of the axle's midpoint, world frame, yaw in (−π, π]
  Twist twist;                         ///< at the axle's midpoint, along the vehicle's heading
  WheelSpeeds rim_speeds;              ///< relative to the chassis: what encoders would measure
  double left_wheel_angle_rad = 0.0;   ///< since the start, unbounded, forward positive
  double right_wheel_angle_rad = 0.0;  ///< since the start, unbounded, forward positive
  double height_m = 0.0;               ///< of the axle's midpoint above the floor
  double roll_rad = 0.0;               ///< positive: leans to the right
  double pitch_rad = 0.0;              ///< positive: nose down
  bool wall_contact = false;           ///< anything touched a wall in the last step
};

/// The AGV in its walled square, as rigid bodies in ODE (docs/physics.md).
///
/// Commands are rim speeds. Each wheel's servo target moves towards its command at no more than
/// `max_wheel_acceleration_mps2`, and the servo drives the wheel to its target with no more than
/// `max_wheel_torque_Nm`; until the first command both commands are zero, so the vehicle brakes.
///
/// Vehicles do not interact and share no state: any number may be stepped from any threads, each
/// by one thread at a time, and equal inputs give bit-identical states.
class OdeVehicle {
 public:
  /// `step` is the fixed physics step; the project uses 1 ms.
  /// Throws std::invalid_argument if the configuration is not a vehicle that can stand.
  OdeVehicle(const VehicleConfig& vehicle, const WorldConfig& world, Duration step);
  ~OdeVehicle();
  OdeVehicle(const OdeVehicle&) = delete;
  OdeVehicle& operator=(const OdeVehicle&) = delete;

  /// Takes effect from the next step on and holds. Both wheels are scaled by one factor to
  /// `max_wheel_speed_mps`. Finite values only.
  void set_wheel_targets(const WheelSpeeds& rim_speeds);

  /// Advances by one physics step.
  void step();

  /// The state after the last step.
  const VehicleState& state() const { return state_; }

  /// The servos' present targets: the commands after both limits. Recorded, they are the input for
  /// a benchmark of the bare world.
  const WheelSpeeds& servo_targets() const { return servo_targets_; }

  /// Warnings of ODE's solver so far (e.g. "LCP internal error, s <= 0" when wedged at a wall).
  std::uint64_t solver_complaints() const { return solver_complaints_; }

 private:
  struct World;
  void read_state();

  VehicleConfig config_;
  double step_s_;
  std::unique_ptr<World> world_;
  WheelSpeeds commands_;
  WheelSpeeds servo_targets_;
  VehicleState state_;
  std::uint64_t solver_complaints_ = 0;
};

}  // namespace tether
