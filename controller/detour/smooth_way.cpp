#include "controller/detour/smooth_way.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <span>
#include <utility>

#include "common/path/waypoint_curve.hpp"
#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

constexpr double kSame_m = 1e-6;
constexpr std::size_t kThin = 8;  // one of this many half moves is kept at first
constexpr double kSample_m = 0.05;

/// With a pose in the middle of each arc.
std::vector<Pose2> in_halves(const std::vector<Pose2>& poses) {
  std::vector<Pose2> more;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (i > 0) {
      const Pose2 &from = poses[i - 1], &to = poses[i];
      const double half_rad = 0.5 * wrap_angle(to.yaw_rad - from.yaw_rad);
      const double chord_m = distance_m(from, to);
      const double bulge = half_rad == 0.0 ? 1.0 : half_rad / std::sin(half_rad);
      const double length_m = chord_m * bulge;
      const bool is_arc = distance_m(along_arc(from, length_m, 2.0 * half_rad), to) < 1e-3;
      if (chord_m > kSame_m && is_arc) more.push_back(along_arc(from, 0.5 * length_m, half_rad));
    }
    more.push_back(poses[i]);
  }
  return more;
}

/// Smooths a sequence of poses from each of which the vehicle drives to the next.
class Smoother {
 public:
  Smoother(std::span<const Pose2> poses, const RoomAt& room_at, double enough_m)
      : poses_(poses), room_at_(room_at), enough_{enough_m, enough_m} {
    for (const Pose2& pose : poses) {
      const Room room = room_at(pose);
      enough_.around_m = std::min(enough_.around_m, room.around_m);
      enough_.ahead_m = std::min(enough_.ahead_m, room.ahead_m);
    }
  }

  std::unique_ptr<const WaypointCurve> curve() const {
    // The second one, for it leaves the first along its heading.
    std::set<std::size_t> kept{1, poses_.size() - 1};
    for (std::size_t i = 0; i < poses_.size(); i += kThin) kept.insert(i);
    while (true) {
      auto curve = curve_through(kept);
      const std::size_t before = kept.size();
      keep_more(*curve, kept);
      if (kept.size() == before) return curve;
    }
  }

 private:
  std::unique_ptr<const WaypointCurve> curve_through(const std::set<std::size_t>& kept) const {
    Waypoints way;
    for (const std::size_t i : kept) {
      way.points.push_back({.x_m = poses_[i].x_m, .y_m = poses_[i].y_m, .v_mps = std::nullopt});
    }
    return std::make_unique<const WaypointCurve>(way);
  }

  bool is_good(const CurvePoint& p) const {
    if (std::abs(p.curvature_1pm) > kSharpestWay_1pm) return false;
    const Room room = room_at_({p.x_m, p.y_m, p.yaw_rad});
    return room.around_m >= enough_.around_m - kLessRoom_m &&
           room.ahead_m >= enough_.ahead_m - kLessRoom_m;
  }

  /// Keeps points in the middle of bad stretches; where all are kept, beside that.
  void keep_more(const WaypointCurve& curve, std::set<std::size_t>& kept) const {
    const std::vector<std::size_t> index(kept.begin(), kept.end());
    const auto samples = static_cast<int>(std::ceil(curve.length_m() / kSample_m));
    std::size_t k = 0;  // the stretch is from index[k] on
    for (int n = 0; n <= samples; ++n) {
      const double s_m = curve.length_m() * n / samples;
      while (k + 2 < index.size() && curve.waypoints_s_m()[k + 1] <= s_m) ++k;
      if (is_good(curve.at(s_m))) continue;
      const bool all = index[k + 1] - index[k] == 1;
      const std::size_t from = all && k > 0 ? k - 1 : k;
      const std::size_t to = std::min(all ? k + 2 : k + 1, index.size() - 1);
      for (std::size_t i = from; i < to; ++i) kept.insert((index[i] + index[i + 1]) / 2);
    }
  }

  std::span<const Pose2> poses_;
  const RoomAt& room_at_;
  Room enough_;
};

}  // namespace

std::vector<WayLeg> smooth_way(const std::vector<Pose2>& plan, const PathLimits& limits,
                               const RoomAt& room_at, double enough_m) {
  const std::vector<Pose2> poses = in_halves(plan);
  std::vector<WayLeg> legs;
  for (std::size_t i = 0; i + 1 < poses.size();) {
    const bool turns = distance_m(poses[i], poses[i + 1]) < kSame_m;
    std::size_t last = i + 1;
    double turn_rad = 0.0;
    for (std::size_t j = i; j + 1 < poses.size(); ++j) {
      if ((distance_m(poses[j], poses[j + 1]) < kSame_m) != turns) break;
      turn_rad += wrap_angle(poses[j + 1].yaw_rad - poses[j].yaw_rad);
      last = j + 1;
    }
    WayLeg leg{.from = poses[i], .turn_rad = turn_rad, .path = nullptr};
    if (!turns) {
      const Smoother smoother(std::span<const Pose2>(poses).subspan(i, last + 1 - i), room_at,
                              enough_m);
      leg = {poses[i], 0.0, std::make_shared<const PlannedPath>(smoother.curve(), limits)};
    }
    legs.push_back(std::move(leg));
    i = last;
  }
  return legs;
}

}  // namespace tether
