#include "controller/detour/detour_driver.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/onboard/stopping_field.hpp"

namespace tether {
namespace {

/// The way is kept so much freer than the vehicle's own field demands, for what poses, commands and
/// their delay are off by.
constexpr double kBeside_m = 0.08;
constexpr double kAheadMore_m = 0.12;
/// Half a side of the square in which it plans.
constexpr double kSquare_m = 16.0;
constexpr double kLookAhead_m = 20.0;  ///< along the path, for where to return
constexpr double kFastestTurn_radps = 0.5;

DetourPlanner::Config planner_config(const AutonomySettings& autonomy, const VehicleConfig& vehicle,
                                     double beside_m) {
  const double half_m = 0.5 * vehicle.chassis_length_m;
  const double width_m = std::max(vehicle.chassis_width_m, vehicle.track_m + vehicle.wheel_width_m);
  return {.rear_m = std::min(-half_m - vehicle.axle_x_m, -vehicle.wheel_radius_m),
          .front_m = std::max(half_m - vehicle.axle_x_m, vehicle.wheel_radius_m),
          .half_width_m = 0.5 * width_m,
          .gap_m = autonomy.side_margin_m + beside_m,
          .ahead_m = autonomy.margin_m + kAheadMore_m,
          .side_m = autonomy.side_margin_m};
}

PathLimits way_limits(const AutonomySettings& autonomy, PathLimits limits) {
  limits.speed_mps = std::min(limits.speed_mps, autonomy.remote_speed_mps);
  limits.max_acceleration_mps2 = std::min(limits.max_acceleration_mps2, autonomy.deceleration_mps2);
  limits.max_deceleration_mps2 = std::min(limits.max_deceleration_mps2, autonomy.deceleration_mps2);
  limits.max_yaw_rate_radps = std::min(limits.max_yaw_rate_radps, kFastestTurn_radps);
  limits.max_yaw_acceleration_radps2 =
      std::min(limits.max_yaw_acceleration_radps2, autonomy.yaw_acceleration_radps2);
  return limits;
}

}  // namespace

DetourDriver::DetourDriver(const AutonomySettings& autonomy, const VehicleConfig& vehicle,
                           std::shared_ptr<const ReferencePath> path, const PathLimits& limits,
                           std::vector<Shape> mapped)
    : planner_(planner_config(autonomy, vehicle, kBeside_m)),
      looser_(planner_config(autonomy, vehicle, 0.0)),
      limits_(way_limits(autonomy, limits)),
      path_(std::move(path)),
      mapped_(std::move(mapped)) {}

void DetourDriver::begin() {
  memory_.clear();
  way_ = {};
  planned_.reset();
  hopeless_.reset();
  in_vain_ = 0;
}

void DetourDriver::see(Instant now, const std::vector<Position>& obstacles, double path_s_m) {
  memory_.add(now, obstacles);
  path_s_m_ = path_s_m;
  news_ = true;
}

FloorMap DetourDriver::floor_around(const Pose2& pose) const {
  FloorMap floor({pose.x_m, pose.y_m}, kSquare_m);
  for (const Shape& shape : mapped_) floor.add(shape);
  for (const Position& point : memory_.points()) floor.add(point);
  return floor;
}

/// Poses of the path behind its first blocked stretch, or from here on if none is, as far as there
/// is room behind them.
std::vector<Pose2> DetourDriver::goals(const FloorMap& floor) {
  constexpr double kRoom_m = 4.0;
  const std::vector<Pose2> path = path_.poses(path_s_m_, kLookAhead_m);
  std::vector<Pose2> goals;
  std::size_t first = 0;  // pose of the present free stretch
  bool blocked_before = false;
  const auto keep = [&](std::size_t end, bool at_end) {
    for (std::size_t i = first; i < end; ++i) {
      if (at_end || distance_m(path[i], path[end - 1]) > kRoom_m) goals.push_back(path[i]);
    }
  };
  for (std::size_t i = 0; i < path.size(); ++i) {
    if (planner_.is_free(floor, path[i])) continue;
    if (blocked_before && i > first) keep(i, false);
    if (!goals.empty()) return goals;
    blocked_before = true;
    first = i + 1;
  }
  if (first < path.size()) {
    keep(path.size(), path_.ends_by(path_s_m_ + kLookAhead_m));
  }
  return goals;
}

bool DetourDriver::is_obstructed(const Pose2& pose) const {
  const FloorMap floor = floor_around(pose);
  const std::vector<Pose2> ahead = way_.ahead();
  return std::any_of(ahead.begin(), ahead.end(),
                     [&](const Pose2& p) { return !looser_.is_free(floor, p); });
}

bool DetourDriver::needs_plan(Instant now, const Pose2& pose) {
  if (planned_ && now - *planned_ < kPatience) return false;
  if (way_.empty() || way_.off_m(pose) > kOff_m || now - headway_ > kStuck) return true;
  return std::exchange(news_, false) && is_obstructed(pose);
}

void DetourDriver::plan(Instant now, const Pose2& pose) {
  planned_ = headway_ = now;
  if (in_vain_ >= kTries) memory_.forget_before(now - kPatience);
  ++plans_;
  way_ = {};
  Question question{pose, path_s_m_, memory_.points()};
  if (hopeless_ != question) search(pose);
  if (!way_.empty()) {
    in_vain_ = 0;
    return;
  }
  hopeless_ = std::move(question);
  ++none_;
  ++in_vain_;
}

/// A way, and along the path beyond its end, so that the vehicle is on it and straight when it gets
/// there.
void DetourDriver::search(const Pose2& pose) {
  const FloorMap floor = floor_around(pose);
  const auto found = planner_.plan(floor, pose, goals(floor));
  most_expansions_ = std::max<std::int64_t>(most_expansions_, planner_.expansions());
  if (!found) return;
  std::vector<Pose2> way = *found;
  const Pose2 end = way.back();
  double least_m = 1.0;
  const std::vector<Pose2> path = path_.poses(path_s_m_, kLookAhead_m);
  const auto nearest = std::min_element(
      path.begin(), path.end(),
      [&end](const Pose2& a, const Pose2& b) { return distance_m(a, end) < distance_m(b, end); });
  for (auto p = nearest; p != path.end() && distance_m(*p, end) < 3.0; ++p) {
    if (distance_m(*p, end) < least_m || !planner_.is_free(floor, *p)) continue;
    way.push_back(*p);
    least_m = distance_m(*p, end) + 0.3;
  }
  const RoomAt room_at = [&](const Pose2& at) { return planner_.room(floor, at); };
  way_ = WayFollower(smooth_way(way, limits_, room_at, planner_.config().gap_m), limits_);
}

Twist DetourDriver::drive(Instant now, const Pose2& pose) {
  if (needs_plan(now, pose)) plan(now, pose);
  const Twist twist = way_.drive(pose);
  if (way_.made_headway()) headway_ = now;
  return twist;
}

void DetourDriver::list(CounterList& out) const {
  out.emplace_back("detour.plans", plans_);
  out.emplace_back("detour.none", none_);
  out.emplace_back("detour.most_expansions", most_expansions_);
}

}  // namespace tether
