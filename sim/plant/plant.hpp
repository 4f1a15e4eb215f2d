#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"

namespace tether {

/// The truth about the vehicle after a step.
struct VehicleState {
  Pose2 pose;              ///< pose of the axle's midpoint, world frame, yaw in (−π, π]
  Twist twist;             ///< at the axle's midpoint, along the vehicle's heading
  WheelSpeeds rim_speeds;  ///< relative to the chassis: what encoders would measure
  double left_wheel_angle_rad = 0.0;   ///< since the start, unbounded, forward positive
  double right_wheel_angle_rad = 0.0;  ///< since the start, unbounded, forward positive
  double left_torque_Nm = 0.0;         ///< torque of the motor in the last step, forward positive
  double right_torque_Nm = 0.0;  ///< torque of the right motor; both 0 for plants without forces
  double height_m = 0.0;         ///< height of the axle's midpoint above the floor
  double roll_rad = 0.0;         ///< positive: leans to the right
  double pitch_rad = 0.0;        ///< positive: nose down
  bool wall_contact = false;     ///< anything touched a wall or an obstacle in the last step
};

/// A vehicle with two driven wheels in its walled square and between what stands and moves there,
/// moved in fixed steps. Deterministic: equal inputs give bit-identical states. Plants share no
/// state with each other.
class Plant {
 public:
  virtual ~Plant() = default;

  /// Takes effect from the next step on and holds. Both wheels are scaled by one factor to
  /// `max_wheel_speed_mps`. Throws std::invalid_argument for values that are not finite.
  virtual void set_wheel_targets(const WheelSpeeds& rim_speeds) = 0;

  /// When the next step begins, since the run's start. Only obstacles that move ask for it.
  void set_time(double t_s) { t_s_ = t_s; }

  /// Other vehicles that may be near in the next step, where they are when it begins; only with
  /// Surroundings::vehicles_mps. They are looked at then.
  virtual void set_vehicles(std::span<const Shape> vehicles) = 0;

  /// Advances by one physics step.
  virtual void step() = 0;

  struct Steps {
    std::int64_t taken = 0;
    std::int64_t in_contact = 0;  ///< steps with wall_contact() after them
  };
  /// Takes steps from `from` on, while the wheel targets stay: 1 to `most` of them. However steps
  /// are divided among calls of this, the states are the same to the bit.
  virtual Steps take(std::int64_t most, Instant from);

  /// The state after the last step.
  virtual VehicleState state() const = 0;
  /// Parts of the state that are needed after each step: cheaper than all of it.
  virtual Position position() const = 0;
  virtual bool wall_contact() const = 0;

  /// The servos' present targets: the commands after the limits of speed and acceleration.
  virtual const WheelSpeeds& servo_targets() const = 0;

  /// Warnings of a numerical solver so far; 0 for plants that have none.
  virtual std::uint64_t solver_complaints() const = 0;

 protected:
  explicit Plant(Duration step) : step_(step), step_s_(to_seconds(step)) {}
  Plant(const Plant&) = delete;
  Plant& operator=(const Plant&) = delete;

  double t_s_ = 0.0;
  Duration step_;
  double step_s_;  ///< the same
};

/// For the plants' own checks: throws std::invalid_argument, "vehicle or world: " and `what`,
/// unless `good`. Write conditions so that NaN fails them.
void require_plant(bool good, const char* what);
/// Checks the start pose and time step, as all plants require.
void check_start_and_step(const VehicleConfig& vehicle, const WorldSettings& world, double step_s);

/// The plant that `vehicle.plant` names. `step` is the fixed physics step; world.step_ms.
/// `seed`: the run's; bumps have the stream "<vehicle>/bumps", what moves has its own. Throws
/// std::invalid_argument if the configuration is not a vehicle that can stand, UsageError for what
/// is wrong with the surroundings' map.
std::unique_ptr<Plant> make_plant(const VehicleSettings& vehicle, const WorldSettings& world,
                                  Duration step, std::uint64_t seed = 0,
                                  const Surroundings& surroundings = {});

}  // namespace tether
