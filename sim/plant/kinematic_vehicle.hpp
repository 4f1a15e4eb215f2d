#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "common/base/time.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/surroundings.hpp"
#include "sim/obstacles/near_obstacles.hpp"
#include "sim/plant/plant.hpp"
#include "sim/plant/walled_footprint.hpp"

namespace tether {

/// The AGV as two rolling wheels, for sweeps and predictions: no masses, no forces, no slip but at
/// walls and obstacles (docs/explanation/physics.md).
///
/// Each wheel's rim speed moves to its command at no more than `max_wheel_acceleration_mps2`. In a
/// step() the vehicle drives the arc of the mean rim speeds: exact at constant speeds; while it
/// accelerates, the position is off by at most step³/12 · (|v| |dω/dt| + |ω| |dv/dt|) a step, 4 nm
/// with the default limits. To take() steps at once is exact: an arc, or while it accelerates, by
/// Gauss's quadrature to 1 pm. At walls, WalledFootprint takes the place of the tyres' grip; the
/// wheels turn as commanded and slip.
class KinematicVehicle final : public Plant {
 public:
  /// `step` is the fixed step, world.step_ms; `seed` that of what moves.
  /// Throws std::invalid_argument for sizes and limits that are not positive, and for a start that
  /// is not between the walls.
  KinematicVehicle(const VehicleConfig& vehicle, const WorldSettings& world, Duration step,
                   const Surroundings& surroundings = {}, std::uint64_t seed = 0);

  void set_wheel_targets(const WheelSpeeds& rim_speeds) override;
  void set_vehicles(std::span<const Shape> vehicles) override {
    if (!obstacles_) return;
    obstacles_->set_vehicles(vehicles);
    reachable_ = obstacles_->any() ? obstacles_.get() : nullptr;
  }
  void step() override;
  /// In closed form, wherever neither a wall nor an obstacle is within reach; elsewhere one.
  Steps take(std::int64_t most, Instant from) override;
  VehicleState state() const override { return state_; }
  Position position() const override { return {state_.pose.x_m, state_.pose.y_m}; }
  bool wall_contact() const override { return state_.wall_contact; }
  const WheelSpeeds& servo_targets() const override { return state_.rim_speeds; }
  std::uint64_t solver_complaints() const override { return 0; }

 private:
  bool turn_wheels();
  void move(const PlanarMotion& motion);
  bool begin_phase();
  void follow_phase();
  void end_phase() { phase_.steps = phase_.taken = 0; }
  std::span<const Shape> near_obstacles(double t_s);
  void move_at_walls(const PlanarMotion& wish, std::span<const Shape> near);

  // Members that each step needs are adjacent: of a fleet, many take turns in the caches.
  double max_change_mps_;
  double wheel_radius_m_, track_m_, max_wheel_speed_mps_;
  WheelSpeeds commands_;
  WheelSpeeds mean_;                    ///< rim speeds in the last step
  NearObstacles* reachable_ = nullptr;  ///< null while there is nothing to be near to
  bool jammed_ = false;                 ///< at walls, the last step's wheel speeds moved nothing
  VehicleState state_;
  /// Steps in which both rims change evenly, reckoned from where they began.
  struct Phase {
    std::int64_t steps = 0, taken = 0;
    WheelSpeeds change;  ///< change of the rims' speeds per step
    WheelSpeeds rims;
    Pose2 pose;
    double left_wheel_angle_rad, right_wheel_angle_rad;
  };
  Phase phase_;
  WalledFootprint footprint_;
  std::unique_ptr<NearObstacles> obstacles_;  ///< if there are any, or may be
};

}  // namespace tether
