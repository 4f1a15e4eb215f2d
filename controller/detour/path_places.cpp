#include "controller/detour/path_places.hpp"

#include <algorithm>
#include <cmath>

namespace tether {
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

}  // namespace tether
