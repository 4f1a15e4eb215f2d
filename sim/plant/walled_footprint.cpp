#include "sim/plant/walled_footprint.hpp"

#include <algorithm>
#include <cmath>
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

}  // namespace tether
