#include "controller/detour/detour_driver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/world/stopping_field.hpp"

namespace tether {
namespace {

constexpr double kMemoryCell_m = 0.1;
constexpr std::size_t kMostCells = 5000;

}  // namespace

void ObstacleMemory::add(Instant now, const std::vector<Position>& points) {
  for (const Position& p : points) {
    const std::pair cell{std::llround(p.x_m / kMemoryCell_m), std::llround(p.y_m / kMemoryCell_m)};
    if (seen_.size() < kMostCells || seen_.contains(cell)) seen_[cell] = now;
  }
}

void ObstacleMemory::forget_before(Instant when) {
  std::erase_if(seen_, [when](const auto& entry) { return entry.second < when; });
}

std::vector<Position> ObstacleMemory::points() const {
  std::vector<Position> points;
  points.reserve(seen_.size());
  for (const auto& [cell, when] : seen_) {
    points.push_back({static_cast<double>(cell.first) * kMemoryCell_m,
                      static_cast<double>(cell.second) * kMemoryCell_m});
  }
  return points;
}

namespace {

constexpr double kStep_s = 0.05;
/// A path that rests for this long has ended.
constexpr double kRest_s = 30.0;

}  // namespace

void PathPlaces::learn(double until_m) {
  double rested_s = 0.0;
  while (!ended_ && (places_.empty() || places_.back().s_m < until_m)) {
    const PathPoint p = path_->at(t_s_);
    t_s_ += kStep_s;
    const Pose2 pose{p.x_m, p.y_m, p.yaw_rad};
    if (places_.empty()) {
      places_.push_back({0.0, pose});
      continue;
    }
    const Place& last = places_.back();
    const double step_m = std::hypot(pose.x_m - last.pose.x_m, pose.y_m - last.pose.y_m);
    rested_s = step_m > 0.0 ? 0.0 : rested_s + kStep_s;
    ended_ = rested_s > kRest_s;
    if (step_m > 0.0) places_.push_back({last.s_m + step_m, pose});
  }
}

bool PathPlaces::ends_by(double s_m) {
  learn(s_m);
  return ended_ && places_.back().s_m <= s_m;
}

std::vector<Pose2> PathPlaces::poses(double from_m, double length_m) {
  learn(from_m + length_m);
  std::vector<Pose2> poses;
  double next_m = from_m;
  const auto first =
      std::lower_bound(places_.begin(), places_.end(), from_m,
                       [](const Place& place, double s_m) { return place.s_m < s_m; });
  for (auto place = first; place != places_.end() && place->s_m <= from_m + length_m; ++place) {
    if (place->s_m < next_m) continue;
    poses.push_back(place->pose);
    next_m = place->s_m + 0.5 * kApart_m;
  }
  return poses;
}

namespace {

/// A profile begins at rest: the vehicle is to be as fast at its start as it is so far on, where a
/// pose that is late says that it has not moved yet.
constexpr double kOff_m = 0.2;
/// The vehicle is looked for so far ahead of where it was: what it drives between two poses.
constexpr double kWindow_m = 1.0;

}  // namespace

WayFollower::WayFollower(std::vector<WayLeg> legs, const PathLimits& limits)
    : legs_(std::move(legs)),
      fastest_turn_radps_(limits.max_yaw_rate_radps),
      creep_mps_(std::min(kCreep_mps, limits.speed_mps)) {
  for (const WayLeg& leg : legs_) {
    std::vector<Place>& places = places_.emplace_back();
    if (leg.path == nullptr) continue;
    for (const SpeedProfile::Motion& step : leg.path->profile().steps()) {
      const PathPoint p = leg.path->point(step);
      places.push_back({step.s_m, step.v_mps, {p.x_m, p.y_m, p.yaw_rad}});
    }
  }
}

bool WayFollower::has_turned(const Pose2& pose) {
  const WayLeg& leg = legs_[leg_];
  turned_rad_ += wrap_angle(pose.yaw_rad - leg.from.yaw_rad - turned_rad_);
  return std::abs(leg.turn_rad - turned_rad_) < kTurned_rad;
}

bool WayFollower::has_arrived(const Pose2& pose) {
  const std::vector<Place>& places = places_[leg_];
  double least_m = distance_m(places[place_].pose, pose);
  const double until_m = places[place_].s_m + kWindow_m;
  for (std::size_t i = place_ + 1; i < places.size() && places[i].s_m <= until_m; ++i) {
    const double off_m = distance_m(places[i].pose, pose);
    if (off_m > least_m) continue;
    least_m = off_m;
    place_ = i;
  }
  return places.back().s_m - places[place_].s_m < kReached_m;
}

void WayFollower::pass_by(const Pose2& pose) {
  while (leg_ < legs_.size()) {
    if (legs_[leg_].path == nullptr ? !has_turned(pose) : !has_arrived(pose)) return;
    ++leg_;
    place_ = 0;
    turned_rad_ = 0.0;
  }
}

bool WayFollower::made_headway() {
  const bool turns = leg_ < legs_.size() && legs_[leg_].path == nullptr;
  const double way = leg_ == legs_.size() ? 0.0
                     : turns              ? std::abs(turned_rad_)
                                          : places_[leg_][place_].s_m;
  if (leg_ == leg_then_ && way < way_then_ + (turns ? kTurnApart_rad : kApart_m)) return false;
  leg_then_ = leg_;
  way_then_ = way;
  return true;
}

Twist WayFollower::turn() const {
  const double left_rad = legs_[leg_].turn_rad - turned_rad_;
  return {0.0, std::clamp(kTurnGain * left_rad, -fastest_turn_radps_, fastest_turn_radps_)};
}

/// kAhead_m farther along the curve, and beyond its end as it points there.
Position WayFollower::aim() const {
  const std::vector<Place>& places = places_[leg_];
  const double s_m = places[place_].s_m + kAhead_m;
  const Place& end = places.back();
  const auto place =
      std::lower_bound(places.begin() + static_cast<std::ptrdiff_t>(place_), places.end(), s_m,
                       [](const Place& p, double s) { return p.s_m < s; });
  if (place != places.end()) return {place->pose.x_m, place->pose.y_m};
  const double beyond_m = s_m - end.s_m;
  return {end.pose.x_m + beyond_m * std::cos(end.pose.yaw_rad),
          end.pose.y_m + beyond_m * std::sin(end.pose.yaw_rad)};
}

double WayFollower::profile_mps() const {
  const std::vector<Place>& places = places_[leg_];
  std::size_t at = place_;
  while (at + 1 < places.size() && places[at].s_m < kOff_m) ++at;
  return std::max(places[at].v_mps, creep_mps_);
}

Twist WayFollower::pursue(const Pose2& pose) const {
  const Position to = aim();
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  const double dx = to.x_m - pose.x_m, dy = to.y_m - pose.y_m;
  const double x = c * dx + s * dy, y = c * dy - s * dx;
  if (x <= 0.05) {
    return {0.0,
            std::clamp(kTurnGain * std::atan2(y, x), -fastest_turn_radps_, fastest_turn_radps_)};
  }
  const double curvature_1pm = 2.0 * y / std::max(x * x + y * y, 0.04);
  const double v_mps =
      std::min(profile_mps(), fastest_turn_radps_ / std::max(std::abs(curvature_1pm), 1e-3));
  return {v_mps, v_mps * curvature_1pm};
}

Twist WayFollower::drive(const Pose2& pose) {
  pass_by(pose);
  if (leg_ == legs_.size()) return {};
  return legs_[leg_].path == nullptr ? turn() : pursue(pose);
}

double WayFollower::off_m(const Pose2& pose) const {
  double off_m = std::numeric_limits<double>::infinity();
  for (const WayLeg& leg : legs_) off_m = std::min(off_m, distance_m(leg.from, pose));
  for (const std::vector<Place>& places : places_) {
    for (const Place& place : places) off_m = std::min(off_m, distance_m(place.pose, pose));
  }
  return off_m;
}

std::vector<Pose2> WayFollower::ahead() const {
  std::vector<Pose2> ahead;
  for (std::size_t leg = leg_; leg < legs_.size(); ++leg) {
    double next_m =
        leg == leg_ && !places_[leg].empty() ? places_[leg][place_].s_m + kApart_m : 0.0;
    for (const Place& place : places_[leg]) {
      if (place.s_m < next_m) continue;
      ahead.push_back(place.pose);
      next_m = place.s_m + kApart_m;
    }
  }
  return ahead;
}

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
