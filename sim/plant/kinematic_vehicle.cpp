#include "sim/plant/kinematic_vehicle.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

// Sweeps over the contacts stop when none changes the motion by more than this. Two contacts of one
// face need about ten; narrow corners more.
constexpr double kPrecision_mps = 1e-10;
constexpr int kMaxSweeps = 200;
// Nearer than this is contact.
constexpr double kTouching_m = 1e-6;
// Maximum number of pushes; an overlap that remains after them stays.
constexpr int kMostPushes = 8;

}  // namespace

WalledFootprint::WalledFootprint(const VehicleConfig& vehicle, const WorldSettings& world)
    : half_extent_m_(world.half_extent_m),
      vehicle_(vehicle),
      friction_(world.wall_friction),
      turn_weight_m2_(vehicle.track_m * vehicle.track_m / 4.0) {
  const double front_m = -vehicle.axle_x_m + vehicle.chassis_length_m / 2.0;
  const double rear_m = front_m - vehicle.chassis_length_m;
  const double box_m = vehicle.chassis_width_m / 2.0;
  const double tyre_m = (vehicle.track_m + vehicle.wheel_width_m) / 2.0;
  const double radius_m = vehicle.wheel_radius_m;
  outline_ = {{{front_m, box_m},
               {front_m, -box_m},
               {rear_m, box_m},
               {rear_m, -box_m},
               {radius_m, tyre_m},
               {radius_m, -tyre_m},
               {-radius_m, tyre_m},
               {-radius_m, -tyre_m}}};
  for (const Point& p : outline_) reach_m_ = std::max(reach_m_, std::hypot(p.x_m, p.y_m));
}

void WalledFootprint::find_contacts(const Pose2& pose, double reach_mps, double step_s) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  contacts_.clear();
  for (const auto& [nx, ny] : {std::pair{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}}) {
    const double gap_m = half_extent_m_ - (nx * pose.x_m + ny * pose.y_m);
    const double forward = c * nx + s * ny, left = c * ny - s * nx;  // the wall's direction
    for (const Point& p : outline_) {
      const double limit_mps = (gap_m - (forward * p.x_m + left * p.y_m)) / step_s;
      if (limit_mps > reach_mps) continue;
      contacts_.push_back({{{forward, left, p.x_m * left - p.y_m * forward}},
                           {{-left, forward, p.x_m * forward + p.y_m * left}},
                           limit_mps});
    }
  }
}

void WalledFootprint::find_contacts(const Pose2& pose, double reach_mps, double step_s,
                                    const Shape& obstacle) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  for (const Shape& part : footprint(vehicle_, pose)) {
    const Touch contact = touch(part, obstacle);
    const Position& n = contact.normal();
    const double away_mps = obstacle.vx_mps * n.x_m + obstacle.vy_mps * n.y_m;
    const double forward = c * n.x_m + s * n.y_m, left = c * n.y_m - s * n.x_m;
    for (const Touch::Point& point : contact.points()) {
      // An overlap is push_inside()'s.
      const double limit_mps = std::max(0.0, point.gap_m) / step_s + away_mps;
      if (limit_mps > reach_mps) continue;
      const double dx = point.at.x_m - pose.x_m, dy = point.at.y_m - pose.y_m;
      const double x = c * dx + s * dy, y = c * dy - s * dx;
      contacts_.push_back({{{forward, left, x * left - y * forward}},
                           {{-left, forward, x * forward + y * left}},
                           limit_mps,
                           obstacle.vy_mps * n.x_m - obstacle.vx_mps * n.y_m});
    }
  }
}

double WalledFootprint::speed_mps(const Direction& d) const {
  return d.row[0] * motion_[0] + d.row[1] * motion_[1] + d.row[2] * motion_[2];
}

/// Replaces the force in a direction; returns by how much it changed.
double WalledFootprint::push(Direction& direction, double force) {
  const double change = force - direction.force;
  direction.force = force;
  motion_[0] -= change * direction.row[0];
  motion_[1] -= change * direction.row[1];
  motion_[2] -= change * direction.row[2] / turn_weight_m2_;
  return std::abs(change);
}

/// Pushes as hard as this contact alone needs: away from the wall, never towards it, and along the
/// wall within the limit of friction.
double WalledFootprint::push(Contact& contact) {
  const auto stopping = [this](const Direction& d, double limit_mps) {
    return d.force + (speed_mps(d) - limit_mps) / (1.0 + d.row[2] * d.row[2] / turn_weight_m2_);
  };
  Direction& outward = contact.outward;
  const double change = push(outward, std::max(0.0, stopping(outward, contact.limit_mps)));
  const double most = friction_ * outward.force;
  return change +
         push(contact.along, std::clamp(stopping(contact.along, contact.along_mps), -most, most));
}

PlanarMotion WalledFootprint::between_walls(const Pose2& pose, const PlanarMotion& wish,
                                            double step_s, std::span<const Shape> near) {
  const double norm_mps =
      std::sqrt(wish.forward_mps * wish.forward_mps + wish.left_mps * wish.left_mps +
                turn_weight_m2_ * wish.omega_radps * wish.omega_radps);
  double fastest_mps = norm_mps;
  for (const Shape& obstacle : near) {
    fastest_mps = std::max(fastest_mps, norm_mps + std::hypot(obstacle.vx_mps, obstacle.vy_mps));
  }
  const double reach_mps = fastest_mps * (1.0 + reach_m_ / std::sqrt(turn_weight_m2_));
  find_contacts(pose, reach_mps, step_s);
  for (const Shape& obstacle : near) find_contacts(pose, reach_mps, step_s, obstacle);
  motion_[0] = wish.forward_mps, motion_[1] = wish.left_mps, motion_[2] = wish.omega_radps;
  bool settled = contacts_.empty();
  for (int sweep = 0; sweep < kMaxSweeps && !settled; ++sweep) {
    double change = 0.0;
    for (Contact& contact : contacts_) change += push(contact);
    settled = change <= kPrecision_mps;
  }
  return {motion_[0], motion_[1], motion_[2]};
}

/// Out of what moves, or of what stands.
bool WalledFootprint::push_out(Pose2& pose, std::span<const Shape> near, bool moving) const {
  bool touches = false, overlaps = true;
  for (int round = 0; round < kMostPushes && overlaps; ++round) {
    overlaps = false;
    for (const Shape& obstacle : near) {
      const bool moves = obstacle.vx_mps != 0.0 || obstacle.vy_mps != 0.0;
      if (moves != moving) continue;
      for (std::size_t i = 0; i < 2; ++i) {
        const Touch contact = touch(footprint(vehicle_, pose)[i], obstacle);
        touches = touches || contact.gap_m() < kTouching_m;
        if (contact.gap_m() >= 0.0) continue;
        overlaps = true;
        pose.x_m += contact.gap_m() * contact.normal().x_m;
        pose.y_m += contact.gap_m() * contact.normal().y_m;
      }
    }
  }
  return touches;
}

/// Extent of the outline, from the axle's midpoint, along the world's axes.
WalledFootprint::Extent WalledFootprint::extent(double yaw_rad) const {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  Extent all{reach_m_, -reach_m_, reach_m_, -reach_m_};
  for (const Point& p : outline_) {
    const double x = c * p.x_m - s * p.y_m, y = s * p.x_m + c * p.y_m;
    all.high_x_m = std::max(all.high_x_m, x), all.low_x_m = std::min(all.low_x_m, x);
    all.high_y_m = std::max(all.high_y_m, y), all.low_y_m = std::min(all.low_y_m, y);
  }
  return all;
}

double WalledFootprint::free_time_s(const Pose2& pose, double v_mps, double omega_radps,
                                    double enough_s) const {
  const double free_way = free_way_m(pose);
  if (free_way > v_mps * enough_s) return enough_s;
  const Extent outline = extent(pose.yaw_rad);
  const double gap_m =
      half_extent_m_ - std::max({pose.x_m + outline.high_x_m, -pose.x_m - outline.low_x_m,
                                 pose.y_m + outline.high_y_m, -pose.y_m - outline.low_y_m});
  const double time_s = std::max(free_way / v_mps, gap_m / (v_mps + omega_radps * reach_m_));
  return std::isnan(time_s) ? 0.0 : time_s;
}

bool WalledFootprint::push_inside(Pose2& pose, std::span<const Shape> near) const {
  bool touches = push_out(pose, near, true);
  touches = push_out(pose, near, false) || touches;
  const Extent outline = extent(pose.yaw_rad);
  const auto keep = [this](double& at, double low, double high) {
    const double most = half_extent_m_ - high, least = -half_extent_m_ - low;
    at = std::max(least, std::min(most, at));
    return at > most - kTouching_m || at < least + kTouching_m;
  };
  const bool touches_x = keep(pose.x_m, outline.low_x_m, outline.high_x_m);
  const bool touches_y = keep(pose.y_m, outline.low_y_m, outline.high_y_m);
  return touches || touches_x || touches_y;
}

namespace {

// A vehicle that is slower than this at walls stands: this much is left by the solver's rounding.
constexpr double kStanding_mps = 1e-8;
// Phases are no longer than this, and while rims change than that.
constexpr double kLongestPhase_s = 60.0, kLongestAcceleration_s = 0.02;
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

/// The exact arc: the chord has the mean heading, and is shorter by sinc of half the turn.
Pose2 after_arc(const Pose2& from, const PlanarMotion& motion, double t_s) {
  const double half_turn_rad = 0.5 * motion.omega_radps * t_s;
  const double heading_rad = from.yaw_rad + half_turn_rad;
  const double c = std::cos(heading_rad), s = std::sin(heading_rad);
  const double scale_s = sinc(half_turn_rad) * t_s;
  return {from.x_m + scale_s * (c * motion.forward_mps - s * motion.left_mps),
          from.y_m + scale_s * (s * motion.forward_mps + c * motion.left_mps),
          wrap_angle(from.yaw_rad + 2.0 * half_turn_rad)};
}

/// While the twist changes evenly: Gauss's quadrature with three points (Abramowitz and Stegun,
/// 25.4.30), off by |d⁶/dt⁶ (v cos yaw)| · t⁷ / 2 016 000.
Pose2 after_acceleration(const Pose2& from, const Twist& first, const Twist& last, double t_s) {
  const double v_change = last.v_mps - first.v_mps;
  const double turn_change_rad = (last.omega_radps - first.omega_radps) * t_s;
  const double turn_rad = first.omega_radps * t_s;
  constexpr double kNode = 0.3872983346207417, kOuter = 5.0 / 18.0, kInner = 8.0 / 18.0;
  Pose2 pose = from;
  for (const auto& [u, weight] :
       {std::pair{0.5 - kNode, kOuter}, {0.5, kInner}, {0.5 + kNode, kOuter}}) {
    const double yaw_rad = from.yaw_rad + u * (turn_rad + 0.5 * u * turn_change_rad);
    const double way_m = weight * t_s * (first.v_mps + u * v_change);
    pose.x_m += way_m * std::cos(yaw_rad);
    pose.y_m += way_m * std::sin(yaw_rad);
  }
  pose.yaw_rad = wrap_angle(from.yaw_rad + turn_rad + 0.5 * turn_change_rad);
  return pose;
}

/// By how much a rim changes in each of how many whole steps.
std::pair<double, double> even_change(double from_mps, double to_mps, double most_mps) {
  const double way_mps = std::abs(to_mps - from_mps);
  if (way_mps == 0.0) return {0.0, INFINITY};
  if (way_mps < most_mps) return {to_mps - from_mps, 1.0};
  return {std::copysign(most_mps, to_mps - from_mps), std::floor(way_mps / most_mps)};
}

}  // namespace

KinematicVehicle::KinematicVehicle(const VehicleConfig& vehicle, const WorldSettings& world,
                                   Duration step, const Surroundings& surroundings,
                                   std::uint64_t seed)
    : Plant(step),
      max_change_mps_(vehicle.max_wheel_acceleration_mps2 * step_s_),
      wheel_radius_m_(vehicle.wheel_radius_m),
      track_m_(vehicle.track_m),
      max_wheel_speed_mps_(vehicle.max_wheel_speed_mps),
      footprint_(vehicle, world) {
  check_drivable(vehicle, world, step_s_);
  state_.pose = vehicle.start_pose();
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
  const WheelSpeeds before = commands_;
  commands_ = saturate(rim_speeds, max_wheel_speed_mps_);
  if (commands_ != before) end_phase();
}

void KinematicVehicle::step() {
  end_phase();
  const bool steady = turn_wheels();
  const bool free_again = reachable_ != nullptr && reachable_->any_moves();
  if (steady && jammed_ && !free_again) return;
  const Twist wish = to_twist(mean_, track_m_);
  const PlanarMotion motion{wish.v_mps, 0.0, wish.omega_radps};
  const double travel_m = (std::abs(mean_.left_mps) + std::abs(mean_.right_mps)) * step_s_;
  const std::span<const Shape> near = near_obstacles(t_s_);
  if (!near.empty() || travel_m >= footprint_.free_way_m(state_.pose)) {
    move_at_walls(motion, near);
    return;
  }
  move(motion);
  state_.twist = to_twist(state_.rim_speeds, track_m_);
  state_.wall_contact = jammed_ = false;
}

Plant::Steps KinematicVehicle::take(std::int64_t most, Instant from) {
  const bool free = reachable_ == nullptr && (phase_.taken < phase_.steps || begin_phase());
  if (!free) return Plant::take(1, from);
  const std::int64_t steps = std::min(most, phase_.steps - phase_.taken);
  phase_.taken += steps;
  follow_phase();
  return {steps, 0};
}

/// False where a wall is within reach of the next step.
bool KinematicVehicle::begin_phase() {
  const WheelSpeeds& rims = state_.rim_speeds;
  const auto [left, left_steps] = even_change(rims.left_mps, commands_.left_mps, max_change_mps_);
  const auto [right, right_steps] =
      even_change(rims.right_mps, commands_.right_mps, max_change_mps_);
  const bool steady = left == 0.0 && right == 0.0;
  const double longest_s = steady ? kLongestPhase_s : kLongestAcceleration_s;
  const double most = std::min({left_steps, right_steps, std::max(1.0, longest_s / step_s_)});
  const Twist first = to_twist(rims, track_m_);
  const Twist last =
      to_twist({rims.left_mps + most * left, rims.right_mps + most * right}, track_m_);
  const double free_s = footprint_.free_time_s(
      state_.pose, std::max(std::abs(first.v_mps), std::abs(last.v_mps)),
      std::max(std::abs(first.omega_radps), std::abs(last.omega_radps)), (most + 1.0) * step_s_);
  // Beyond the last step that ends free, nothing is known.
  const double steps = std::min(most, std::ceil(free_s / step_s_) - 1.0);
  if (!(steps >= 1.0)) return false;
  phase_ = {.steps = static_cast<std::int64_t>(steps),
            .change = {left, right},
            .rims = rims,
            .pose = state_.pose,
            .left_wheel_angle_rad = state_.left_wheel_angle_rad,
            .right_wheel_angle_rad = state_.right_wheel_angle_rad};
  return true;
}

void KinematicVehicle::follow_phase() {
  const auto steps = static_cast<double>(phase_.taken);
  const double t_s = steps * step_s_;
  const WheelSpeeds& first = phase_.rims;
  const WheelSpeeds last{first.left_mps + steps * phase_.change.left_mps,
                         first.right_mps + steps * phase_.change.right_mps};
  const double angle_per_mps = 0.5 * t_s / wheel_radius_m_;
  state_.left_wheel_angle_rad =
      phase_.left_wheel_angle_rad + (first.left_mps + last.left_mps) * angle_per_mps;
  state_.right_wheel_angle_rad =
      phase_.right_wheel_angle_rad + (first.right_mps + last.right_mps) * angle_per_mps;
  const Twist before = to_twist(first, track_m_);
  state_.rim_speeds = last;
  state_.twist = to_twist(last, track_m_);
  state_.pose = last == first ? after_arc(phase_.pose, {before.v_mps, 0.0, before.omega_radps}, t_s)
                              : after_acceleration(phase_.pose, before, state_.twist, t_s);
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

void KinematicVehicle::move(const PlanarMotion& motion) {
  state_.pose = after_arc(state_.pose, motion, step_s_);
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
