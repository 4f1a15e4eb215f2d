#include "controller/detour/way_follower.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace tether {
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

}  // namespace tether
