#include "sim/plant/ode_vehicle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/ode_world.hpp"

namespace tether {
namespace {

void check_bodies(const VehicleConfig& v, const WorldSettings& w, double step_s) {
  // Written so that NaN fails too.
  require_plant(v.chassis_length_m > 0 && v.chassis_width_m > 0 && v.chassis_height_m > 0,
                "the chassis needs a positive length, width and height");
  require_plant(v.chassis_mass_kg > 0 && v.wheel_mass_kg > 0 && v.caster_mass_kg >= 0,
                "masses must be positive (the caster's may be 0)");
  require_plant(v.wheel_radius_m > 0 && v.wheel_width_m > 0 && v.caster_radius_m > 0,
                "wheel and caster need positive dimensions");
  require_plant(v.track_m > 0, "the track must be positive");
  require_plant(
      v.max_wheel_torque_Nm > 0 && v.max_wheel_acceleration_mps2 > 0 && v.max_wheel_speed_mps > 0,
      "wheel torque, acceleration and speed limits must be positive");
  require_plant(
      w.half_extent_m > 0 && w.friction >= 0 && w.wall_friction >= 0 && w.gravity_mps2 > 0,
      "walls need a positive distance, friction must not be negative, gravity positive");
  require_plant(v.tyre_stiffness > 0 && v.tyre_relaxation_m > 0,
                "tyres need a positive stiffness and relaxation length");
  check_start_and_step(v, w, step_s);
}

// So near an obstacle is looked at: a vehicle that tilts reaches a little farther than one that
// stands upright.
constexpr double kOdeSlack_m = 0.1;

}  // namespace

struct OdeVehicle::World : OdeWorld {
  using OdeWorld::OdeWorld;
};

OdeVehicle::OdeVehicle(const VehicleConfig& vehicle, const WorldSettings& world, Duration step,
                       RandomEngine random, const Surroundings& surroundings, std::uint64_t seed)
    : Plant(step),
      config_(vehicle),
      max_change_mps_(vehicle.max_wheel_acceleration_mps2 * step_s_),
      disturbances_(vehicle, world, step_s_, random) {
  check_bodies(vehicle, world, step_s_);
  world_ = std::make_unique<World>(vehicle, world, step_s_);
  if (!surroundings.any()) return;
  obstacles_.emplace(vehicle, world, surroundings, seed, step_s_, kOdeSlack_m);
  world_->expect_obstacles(vehicle, obstacles_->fastest_mps());
}

OdeVehicle::~OdeVehicle() = default;

void OdeVehicle::set_wheel_targets(const WheelSpeeds& rim_speeds) {
  if (!std::isfinite(rim_speeds.left_mps) || !std::isfinite(rim_speeds.right_mps)) {
    throw std::invalid_argument("OdeVehicle: a wheel target is not finite");
  }
  commands_ = saturate(rim_speeds, config_.max_wheel_speed_mps);
}

void OdeVehicle::step() {
  prepare_ode_thread();
  const WheelSpeeds begin = config_.anti_windup ? rim_speeds_ : servo_targets_;
  servo_targets_ = approach(begin, commands_, max_change_mps_);

  if (disturbances_.any()) {
    world_->set_wheel_loads(disturbances_.step(rim_speeds_));
  }

  if (obstacles_) world_->set_near(obstacles_->near(pose(), t_s_));
  const std::uint64_t complaints_before = ode_complaints_of_this_thread();
  world_->step(servo_targets_);
  solver_complaints_ += ode_complaints_of_this_thread() - complaints_before;

  // The joint's rate is constant during a step, so this sum is the angle itself.
  rim_speeds_ = world_->rim_speeds();
  left_wheel_angle_rad_ += rim_speeds_.left_mps / config_.wheel_radius_m * step_s_;
  right_wheel_angle_rad_ += rim_speeds_.right_mps / config_.wheel_radius_m * step_s_;
}

Position OdeVehicle::position() const {
  const dReal* position = dBodyGetPosition(world_->chassis());
  dVector3 arm;
  find_arm(arm);
  return {position[0] + arm[0], position[1] + arm[1]};
}

bool OdeVehicle::wall_contact() const { return world_->wall_contact(); }

/// From the chassis body's origin to the axle's midpoint, in the world's frame.
void OdeVehicle::find_arm(double* arm) const {
  dMultiply0_331(arm, dBodyGetRotation(world_->chassis()), world_->axle_in_chassis_m().data());
}

Pose2 OdeVehicle::pose() const {
  const Position at = position();
  const dReal* r = dBodyGetRotation(world_->chassis());
  return {at.x_m, at.y_m, std::atan2(r[4], r[0])};
}

VehicleState OdeVehicle::state() const {
  const dBodyID chassis = world_->chassis();
  const dReal* r = dBodyGetRotation(chassis);
  const dReal* position = dBodyGetPosition(chassis);
  const dReal* velocity = dBodyGetLinearVel(chassis);
  const dReal* spin = dBodyGetAngularVel(chassis);
  dVector3 arm;
  find_arm(arm);
  VehicleState state;
  state.pose = pose();
  state.height_m = position[2] + arm[2];
  state.pitch_rad = -std::asin(std::clamp(r[8], -1.0, 1.0));
  state.roll_rad = std::atan2(r[9], r[10]);

  const double vx = velocity[0] + spin[1] * arm[2] - spin[2] * arm[1];
  const double vy = velocity[1] + spin[2] * arm[0] - spin[0] * arm[2];
  const double heading = std::hypot(r[0], r[4]);
  state.twist.v_mps = heading > 0.0 ? (vx * r[0] + vy * r[4]) / heading : 0.0;
  state.twist.omega_radps = spin[2];
  state.rim_speeds = rim_speeds_;
  state.left_wheel_angle_rad = left_wheel_angle_rad_;
  state.right_wheel_angle_rad = right_wheel_angle_rad_;
  state.left_torque_Nm = world_->motor_torque(OdeWorld::kLeft);
  state.right_torque_Nm = world_->motor_torque(OdeWorld::kRight);
  state.wall_contact = world_->wall_contact();
  return state;
}

}  // namespace tether
