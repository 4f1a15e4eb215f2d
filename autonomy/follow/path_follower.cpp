#include "autonomy/follow/path_follower.hpp"

#include <algorithm>
#include <cmath>

#include "common/path/controlled_point.hpp"
#include "common/path/kinds.hpp"
#include "controller/laws/axle_path.hpp"

namespace tether {
namespace {

/// Slower than this the path rests, or begins to move: its clock goes on by itself.
constexpr double kRests_mps = 0.3;
constexpr double kSample_s = 0.1;

LawSettings on_board(LawSettings settings) {
  auto& controller = settings.get<ControllerSettings>();
  controller.law = "tracking";
  controller.estimator = ControllerSettings::Estimator::none;
  return settings;
}

}  // namespace

std::shared_ptr<const ReferencePath> axle_path(
    const Sections<PathSettings, VehicleSettings>& settings) {
  auto path = make_path(settings.get<PathSettings>());
  const double ahead_m =
      controlled_point_ahead_m(settings.get<PathSettings>(), settings.get<VehicleSettings>());
  if (ahead_m == 0.0) return path;
  return std::make_shared<AxlePath>(path, ahead_m);
}

PathFollower::PathFollower(const LawSettings& settings)
    : path_(axle_path(settings)), law_(make_law(on_board(settings))) {}

Twist PathFollower::wanted(const Pose2& pose, double path_s) {
  SeenPose seen;
  seen.pose = pose;
  const Instant when = kStart + from_seconds(path_s);
  seen.stamp = seen.arrival = when;
  const auto twist = std::get<Twist>(law_->decide(when, &seen));
  return twist.v_mps < 0.0 ? Twist{} : twist;
}

void PathFollower::advance(double dt_s, double v_mps) {
  const double own_mps = path_->at(clock_s_).v_mps;
  const double share = own_mps < kRests_mps ? 1.0 : std::clamp(v_mps / own_mps, 0.0, 1.0);
  const Position before = path_->position_at(clock_s_);
  clock_s_ += share * dt_s;
  way_m_ += distance_m(before, path_->position_at(clock_s_));
}

std::optional<double> PathFollower::place_of(const Pose2& pose) const {
  const Position here{pose.x_m, pose.y_m};
  double nearest_m = kOnPath_m;
  std::optional<double> place;
  for (int i = 0; i * kSample_s <= kSearch_s; ++i) {
    const double t_s = clock_s_ + i * kSample_s;
    const double off_m = distance_m(path_->position_at(t_s), here);
    if (place && off_m > kOnPath_m) break;  // beyond the first stretch that is near enough
    if (off_m >= nearest_m) continue;
    if (std::abs(wrap_angle(path_->at(t_s).yaw_rad - pose.yaw_rad)) > kOnPath_rad) continue;
    nearest_m = off_m;
    place = t_s;
  }
  return place;
}

void PathFollower::go_to(double path_s) {
  for (double t_s = clock_s_; t_s < path_s; t_s += kSample_s) {
    way_m_ +=
        distance_m(path_->position_at(t_s), path_->position_at(std::min(t_s + kSample_s, path_s)));
  }
  clock_s_ = std::max(clock_s_, path_s);
}

std::vector<Pose2> PathFollower::way(double path_s, double length_m) const {
  std::vector<Pose2> poses;
  double way_m = 0.0;
  Position before = path_->position_at(path_s);
  for (int i = 0; way_m <= length_m && i * kSample_s <= kSearch_s; ++i) {
    const PathPoint p = path_->at(path_s + i * kSample_s);
    way_m += distance_m(before, {p.x_m, p.y_m});
    before = {p.x_m, p.y_m};
    poses.push_back({p.x_m, p.y_m, p.yaw_rad});
    if (i > 0 && p.v_mps == 0.0) break;  // its end
  }
  return poses;
}

}  // namespace tether
