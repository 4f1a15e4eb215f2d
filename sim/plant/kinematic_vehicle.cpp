#include "sim/plant/kinematic_vehicle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

// A vehicle that is slower than this at walls stands: this much is left by the solver's rounding.
constexpr double kStanding_mps = 1e-8;
// So near an obstacle is looked at: more than the remainder of a push.
constexpr double kSlack_m = 1e-3;

void check_drivable(const VehicleConfig& v, const WorldSettings& w, double step_s) {
  // Written so that NaN fails too.
  require_plant(v.chassis_length_m > 0 && v.chassis_width_m > 0 && v.wheel_radius_m > 0 &&
                    v.wheel_width_m > 0 && v.track_m > 0,
                "chassis, wheels and track need positive dimensions");
  require_plant(v.max_wheel_acceleration_mps2 > 0 && v.max_wheel_speed_mps > 0,
                "wheel acceleration and speed limits must be positive");
  require_plant(w.half_extent_m > 0 && w.wall_friction >= 0,
                "walls need a positive distance, friction must not be negative");
  check_start_and_step(v, w, step_s);
}

/// sin(x)/x.
double sinc(double x) {
  // Below this, the next term of the series is less than 1e-16.
  constexpr double kSmall = 0.02;
  if (std::abs(x) > kSmall) return std::sin(x) / x;
  const double x2 = x * x;
  return 1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0));
}

}  // namespace

KinematicVehicle::KinematicVehicle(const VehicleConfig& vehicle, const WorldSettings& world,
                                   Duration step, const Surroundings& surroundings,
                                   std::uint64_t seed)
    : step_s_(to_seconds(step)),
      max_change_mps_(vehicle.max_wheel_acceleration_mps2 * step_s_),
      wheel_radius_m_(vehicle.wheel_radius_m),
      track_m_(vehicle.track_m),
      max_wheel_speed_mps_(vehicle.max_wheel_speed_mps),
      footprint_(vehicle, world) {
  check_drivable(vehicle, world, step_s_);
  state_.pose = {vehicle.start_x_m, vehicle.start_y_m, wrap_angle(vehicle.start_yaw_rad)};
  state_.height_m = vehicle.wheel_radius_m;
  if (!surroundings.any()) return;
  obstacles_ =
      std::make_unique<NearObstacles>(vehicle, world, surroundings, seed, step_s_, kSlack_m);
  set_vehicles({});
}

void KinematicVehicle::set_wheel_targets(const WheelSpeeds& rim_speeds) {
  if (!std::isfinite(rim_speeds.left_mps) || !std::isfinite(rim_speeds.right_mps)) {
    throw std::invalid_argument("KinematicVehicle: a wheel target is not finite");
  }
  commands_ = saturate(rim_speeds, max_wheel_speed_mps_);
}

void KinematicVehicle::step() {
  const bool steady = turn_wheels();
  const bool free_again = reachable_ != nullptr && reachable_->any_moves();
  if (steady && jammed_ && !free_again) return;
  const Twist wish = to_twist(mean_, track_m_);
  const PlanarMotion motion{wish.v_mps, 0.0, wish.omega_radps};
  const double travel_m = (std::abs(mean_.left_mps) + std::abs(mean_.right_mps)) * step_s_;
  const std::span<const Shape> near = near_obstacles(t_s_);
  if (!near.empty() || footprint_.may_touch(state_.pose, travel_m)) {
    move_at_walls(motion, near);
    return;
  }
  move(motion);
  state_.twist = to_twist(state_.rim_speeds, track_m_);
  state_.wall_contact = jammed_ = false;
}

std::span<const Shape> KinematicVehicle::near_obstacles(double t_s) {
  if (reachable_ == nullptr) return {};
  return reachable_->near(state_.pose, t_s);
}

/// True if the wheels turned as in the step before.
bool KinematicVehicle::turn_wheels() {
  const WheelSpeeds before = state_.rim_speeds;
  const WheelSpeeds mean_before = mean_;
  state_.rim_speeds = approach(before, commands_, max_change_mps_);
  mean_ = {0.5 * (before.left_mps + state_.rim_speeds.left_mps),
           0.5 * (before.right_mps + state_.rim_speeds.right_mps)};
  state_.left_wheel_angle_rad += mean_.left_mps / wheel_radius_m_ * step_s_;
  state_.right_wheel_angle_rad += mean_.right_mps / wheel_radius_m_ * step_s_;
  return mean_.left_mps == mean_before.left_mps && mean_.right_mps == mean_before.right_mps;
}

/// The exact arc: the chord has the mean heading, and is shorter by sinc of half the turn.
void KinematicVehicle::move(const PlanarMotion& motion) {
  Pose2& pose = state_.pose;
  const double half_turn_rad = 0.5 * motion.omega_radps * step_s_;
  const double heading_rad = pose.yaw_rad + half_turn_rad;
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  const double scale_s = sinc(half_turn_rad) * step_s_;
  pose.x_m += scale_s * (c * motion.forward_mps - s * motion.left_mps);
  pose.y_m += scale_s * (s * motion.forward_mps + c * motion.left_mps);
  pose.yaw_rad = wrap_angle(pose.yaw_rad + 2.0 * half_turn_rad);
}

void KinematicVehicle::move_at_walls(const PlanarMotion& wish, std::span<const Shape> near) {
  const PlanarMotion motion = footprint_.between_walls(state_.pose, wish, step_s_, near);
  jammed_ = std::abs(motion.forward_mps) < kStanding_mps &&
            std::abs(motion.left_mps) < kStanding_mps &&
            std::abs(motion.omega_radps) < kStanding_mps;
  if (!jammed_) move(motion);
  state_.wall_contact = footprint_.push_inside(state_.pose, near_obstacles(t_s_ + step_s_));
  state_.twist = jammed_ ? Twist{} : Twist{motion.forward_mps, motion.omega_radps};
}

}  // namespace tether
