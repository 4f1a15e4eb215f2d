#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"
#include "common/world/surroundings.hpp"
#include "sim/plant/near_obstacles.hpp"
#include "sim/plant/plant.hpp"

namespace tether {

/// Velocity of a rigid body in the plane, in its own frame, at the axle's midpoint.
struct PlanarMotion {
  double forward_mps = 0.0;
  double left_mps = 0.0;
  double omega_radps = 0.0;
};

/// Where the vehicle's outline (chassis box and both wheels) may go in its walled square, and
/// between the obstacles in it.
///
/// Where a motion would take a point of the outline through a wall, the wall pushes the point back,
/// with Coulomb friction along the wall. Obstacles do the same where they touch the outline
/// (sim/plant/near_obstacles.hpp); what moves pushes as fast as it moves, and drags along by
/// friction. A push acts on the motion of a vehicle without inertia whose tyres resist slip equally
/// in all directions and in proportion to it: a force f at the axle's midpoint adds f to the
/// velocity there, a moment m adds m / (track/2)² to ω. Without friction that is the nearest motion
/// that stays inside, by the mean square of both tyres' slip (docs/explanation/physics.md).
class WalledFootprint {
 public:
  WalledFootprint(const VehicleConfig& vehicle, const WorldSettings& world);

  /// How far it may travel from here before any part of it can reach a wall, however it turns; ≤ 0:
  /// not at all.
  double free_way_m(const Pose2& pose) const {
    return half_extent_m_ - reach_m_ - std::max(std::abs(pose.x_m), std::abs(pose.y_m));
  }
  /// For how long no part of it can reach a wall, at these speeds at most; ≤ 0: it may now. With
  /// `enough_s` it does not look closer.
  double free_time_s(const Pose2& pose, double v_mps, double omega_radps, double enough_s) const;

  /// The motion that the walls, and the obstacles that are near, leave of `wish`. It keeps the
  /// outline inside for `step_s`, to first order in the step. `pose` is inside. There is no such
  /// motion where something moves and presses the vehicle at what stands; it is then overlapped.
  PlanarMotion between_walls(const Pose2& pose, const PlanarMotion& wish, double step_s,
                             std::span<const Shape> near);

  /// Moves `pose` by the remainder that between_walls() leaves, so that the outline is inside; true
  /// if it touches a wall or an obstacle. `near`: where they are by now. Of walls and obstacles
  /// that cannot all be kept, those that move are overlapped.
  bool push_inside(Pose2& pose, std::span<const Shape> near) const;

 private:
  struct Point {
    double x_m, y_m;  // from the axle's midpoint
  };
  /// A direction at a point of the outline, as a row that gives the point's speed in it.
  struct Direction {
    double row[3];
    double force = 0.0;  ///< in it, so far; in m/s: the slip that it causes
  };
  /// One point of the outline and one wall or obstacle.
  struct Contact {
    Direction outward, along;
    double limit_mps = 0.0;  ///< limit of the speed outward
    double along_mps = 0.0;  ///< speed of the surface that it rubs on
  };
  struct Extent {
    double low_x_m, high_x_m, low_y_m, high_y_m;
  };
  Extent extent(double yaw_rad) const;
  double speed_mps(const Direction& direction) const;
  double push(Direction& direction, double force);
  double push(Contact& contact);
  void find_contacts(const Pose2& pose, double reach_mps, double step_s);
  void find_contacts(const Pose2& pose, double reach_mps, double step_s, const Shape& obstacle);
  bool push_out(Pose2& pose, std::span<const Shape> near, bool moving) const;

  double half_extent_m_;
  double reach_m_ = 0.0;  ///< reach of the outline, from the axle's midpoint
  VehicleConfig vehicle_;
  double friction_;
  double turn_weight_m2_;  ///< (track/2)²
  std::array<Point, 8> outline_;
  std::vector<Contact> contacts_;
  double motion_[3] = {};  ///< forward, left, turn: as pushed so far
};

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
