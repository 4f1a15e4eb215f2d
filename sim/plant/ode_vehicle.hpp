#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "common/base/time.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/plant/disturbances.hpp"
#include "sim/plant/near_obstacles.hpp"
#include "sim/plant/plant.hpp"

namespace tether {

/// The AGV in its walled square and between obstacles, as rigid bodies in ODE
/// (docs/explanation/physics.md).
///
/// Commands are rim speeds. Each wheel's servo target moves towards its command at no more than
/// `max_wheel_acceleration_mps2`, and the servo drives the wheel to its target with no more than
/// `max_wheel_torque_Nm`; until the first command both commands are zero, so the vehicle brakes.
/// With `anti_windup` each target moves from its wheel's speed.
///
/// Vehicles do not interact and share no state: any number may be stepped from any threads, each
/// by one thread at a time, and equal inputs give bit-identical states.
class OdeVehicle final : public Plant {
 public:
  /// `step` is the fixed physics step, world.step_ms.
  /// Throws std::invalid_argument if the configuration is not a vehicle that can stand.
  /// `random`: of the bumps; `seed`: of what moves.
  OdeVehicle(const VehicleConfig& vehicle, const WorldSettings& world, Duration step,
             RandomEngine random = RandomEngine{}, const Surroundings& surroundings = {},
             std::uint64_t seed = 0);
  ~OdeVehicle() override;
  OdeVehicle(const OdeVehicle&) = delete;
  OdeVehicle& operator=(const OdeVehicle&) = delete;

  void set_wheel_targets(const WheelSpeeds& rim_speeds) override;
  void set_vehicles(std::span<const Shape> vehicles) override {
    if (obstacles_) obstacles_->set_vehicles(vehicles);
  }
  void step() override;
  VehicleState state() const override;
  Position position() const override;
  bool wall_contact() const override;
  const WheelSpeeds& servo_targets() const override { return servo_targets_; }
  /// E.g. "LCP internal error, s <= 0" when wedged at a wall.
  std::uint64_t solver_complaints() const override { return solver_complaints_; }

 private:
  struct World;
  void find_arm(double* arm) const;
  Pose2 pose() const;

  VehicleConfig config_;
  double max_change_mps_;  ///< limit of a servo's target, in a step
  std::unique_ptr<World> world_;
  std::optional<NearObstacles> obstacles_;  ///< if there are any
  Disturbances disturbances_;
  WheelSpeeds commands_;
  WheelSpeeds servo_targets_;
  WheelSpeeds rim_speeds_;  ///< after the last step
  double left_wheel_angle_rad_ = 0.0;
  double right_wheel_angle_rad_ = 0.0;
  std::uint64_t solver_complaints_ = 0;
};

}  // namespace tether
