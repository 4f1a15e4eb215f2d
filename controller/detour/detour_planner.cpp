#include "controller/detour/detour_planner.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <queue>
#include <utility>

#include "common/vehicle/frames.hpp"

namespace tether {

FloorMap::FloorMap(const Position& centre, double half_m)
    : x0_m_(centre.x_m - half_m),
      y0_m_(centre.y_m - half_m),
      side_(static_cast<int>(std::ceil(2.0 * half_m / kCell_m))),
      distance_m_(static_cast<std::size_t>(side_) * static_cast<std::size_t>(side_),
                  static_cast<float>(kFar_m)) {}

template <class Distance>
void FloorMap::lower(double x0, double y0, double x1, double y1, Distance distance) {
  const auto cell = [this](double at_m, double from_m) {
    return static_cast<int>(std::clamp((at_m - from_m) / kCell_m, 0.0, side_ * 1.0));
  };
  for (int j = cell(y0, y0_m_); j < std::min(cell(y1, y0_m_) + 1, side_); ++j) {
    for (int i = cell(x0, x0_m_); i < std::min(cell(x1, x0_m_) + 1, side_); ++i) {
      const Position centre{x0_m_ + (i + 0.5) * kCell_m, y0_m_ + (j + 0.5) * kCell_m};
      float& known = distance_m_[static_cast<std::size_t>(j) * static_cast<std::size_t>(side_) +
                                 static_cast<std::size_t>(i)];
      known = std::min(known, static_cast<float>(distance(centre)));
    }
  }
}

void FloorMap::add(const Shape& shape) {
  const double reach_m = kFar_m + (shape.outline == Shape::Outline::circle
                                       ? shape.radius_m
                                       : 0.5 * std::hypot(shape.length_m, shape.width_m));
  const double x = shape.pose.x_m, y = shape.pose.y_m;
  lower(x - reach_m, y - reach_m, x + reach_m, y + reach_m,
        [&shape](const Position& p) { return tether::distance_m(shape, p); });
}

void FloorMap::add(const Position& point) {
  lower(point.x_m - kFar_m, point.y_m - kFar_m, point.x_m + kFar_m, point.y_m + kFar_m,
        [&point](const Position& p) { return std::hypot(p.x_m - point.x_m, p.y_m - point.y_m); });
}

double FloorMap::distance_m(const Position& p) const {
  const double x = (p.x_m - x0_m_) / kCell_m - 0.5, y = (p.y_m - y0_m_) / kCell_m - 0.5;
  if (!(x >= 0.0 && y >= 0.0 && x < side_ - 1 && y < side_ - 1)) return -kFar_m;
  const auto side = static_cast<std::size_t>(side_);
  const auto i = static_cast<std::size_t>(x), j = static_cast<std::size_t>(y);
  const float* const row = distance_m_.data() + j * side + i;
  const double u = x - static_cast<double>(i), v = y - static_cast<double>(j);
  return (1.0 - v) * ((1.0 - u) * row[0] + u * row[1]) +
         v * ((1.0 - u) * row[side] + u * row[side + 1]);
}

std::vector<Position> rim(double rear_m, double front_m, double half_width_m) {
  constexpr double kApart_m = 0.2;
  std::vector<Position> points;
  const double length_m = front_m - rear_m, width_m = 2.0 * half_width_m;
  const int along = static_cast<int>(std::ceil(length_m / kApart_m));
  const int across = static_cast<int>(std::ceil(width_m / kApart_m));
  for (int i = 0; i <= along; ++i) {
    const double x = rear_m + length_m * i / along;
    points.push_back({x, half_width_m});
    points.push_back({x, 0.0});  // points inside the radius
    points.push_back({x, -half_width_m});
  }
  for (int i = 1; i < across; ++i) {
    const double y = -half_width_m + width_m * i / across;
    points.push_back({rear_m, y});
    points.push_back({front_m, y});
  }
  return points;
}

double gap_m(const FloorMap& floor, const std::vector<Position>& points, const Pose2& pose) {
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  double gap_m = FloorMap::kFar_m;
  for (const Position& p : points) {
    gap_m = std::min(gap_m, floor.distance_m({pose.x_m + c * p.x_m - s * p.y_m,
                                              pose.y_m + s * p.x_m + c * p.y_m}));
  }
  return gap_m;
}

namespace {

constexpr double kStep_rad = 2.0 * std::numbers::pi / DetourPlanner::kHeadings;
constexpr double kMove_m = 0.3;
/// A turn on the spot by a step takes as long as this way.
constexpr double kTurn_m = 0.25;
constexpr double kCell_m = 0.15;
constexpr double kGoal_m = 0.2;
/// Obstacles nearer than this increase a way's cost, up to three times.
constexpr double kNear_m = 0.7;
/// The field of a turn on the spot reaches this much farther than the turn.
constexpr double kBeyondTurn_rad = 0.26;
constexpr double kTurnGap_m = 0.03;

struct Move {
  double length_m;
  int turn;  ///< steps of heading, on an arc or on the spot
};
constexpr std::array<Move, 5> kMoves{
    {{kMove_m, 0}, {kMove_m, 1}, {kMove_m, -1}, {0.0, 1}, {0.0, -1}}};

}  // namespace

class DetourPlanner::Search {
 public:
  Search(const DetourPlanner& planner, const FloorMap& floor, const Pose2& start,
         const std::vector<Pose2>& goals)
      : planner_(planner), floor_(floor), goals_(goals), start_(start) {
    best_.assign(static_cast<std::size_t>(kSide) * kSide * kHeadings, kNone);
    keep_m_ = std::min(planner.config_.gap_m, gap_m(floor, planner.outline_, start) - 0.02);
    if (keep_m_ > 0.0) reach({start, 0, 0.0, -1});
  }

  std::optional<std::vector<Pose2>> run(int& expansions) {
    for (expansions = 0; !open_.empty() && expansions < kMostExpansions; ++expansions) {
      const int i = open_.top().second;
      open_.pop();
      const Node node = nodes_[static_cast<std::size_t>(i)];
      if (best_[cell(node)] != i) continue;  // a better one has come since
      if (is_goal(node.pose)) return way_to(i);
      expand(node, i);
    }
    return std::nullopt;
  }

 private:
  static constexpr int kSide = 240;
  static constexpr int kNone = -1;

  std::size_t cell(const Node& node) const {
    const auto place = [](double at_m, double from_m) {
      return std::clamp(static_cast<int>(std::floor((at_m - from_m) / kCell_m)) + kSide / 2, 0,
                        kSide - 1);
    };
    const int i = place(node.pose.x_m, start_.x_m), j = place(node.pose.y_m, start_.y_m);
    const int number = (j * kSide + i) * kHeadings + node.heading;
    return static_cast<std::size_t>(number);
  }

  double left_m(const Pose2& pose) const {
    double least_m = std::numeric_limits<double>::infinity();
    for (const Pose2& goal : goals_) {
      least_m = std::min(least_m, std::hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m));
    }
    return std::max(least_m - kGoal_m, 0.0);
  }

  bool is_goal(const Pose2& pose) const {
    return std::any_of(goals_.begin(), goals_.end(), [&pose](const Pose2& goal) {
      return std::hypot(goal.x_m - pose.x_m, goal.y_m - pose.y_m) <= kGoal_m &&
             std::abs(wrap_angle(goal.yaw_rad - pose.yaw_rad)) <= 0.5 * kStep_rad + 1e-9;
    });
  }

  void reach(const Node& node) {
    const std::size_t at = cell(node);
    const int known = best_[at];
    if (known != kNone && nodes_[static_cast<std::size_t>(known)].cost <= node.cost) return;
    best_[at] = static_cast<int>(nodes_.size());
    nodes_.push_back(node);
    open_.emplace(node.cost + left_m(node.pose), best_[at]);
  }

  /// The gap all around on a move; none where it is too small.
  std::optional<double> gap_of(const Pose2& from, const Move& move) const {
    const double turn_rad = move.turn * kStep_rad;
    const Pose2 middle = along_arc(from, 0.5 * move.length_m, 0.5 * turn_rad);
    const Pose2 end = along_arc(from, move.length_m, turn_rad);
    const bool drives = move.length_m > 0.0;
    const auto& rim = drives ? planner_.outline_ : planner_.wider_;
    const double least_m = drives ? keep_m_ : kTurnGap_m;
    const double gap = std::min(gap_m(floor_, rim, middle), gap_m(floor_, rim, end));
    if (gap < least_m) return std::nullopt;
    const Pose2 beyond = along_arc(end, 0.0, move.turn * kBeyondTurn_rad);
    const double next_m =
        drives ? gap_m(floor_, planner_.longer_, end) : gap_m(floor_, rim, beyond);
    return next_m >= least_m ? std::optional(gap) : std::nullopt;
  }

  void expand(const Node& node, int i) {
    for (const Move& move : kMoves) {
      const std::optional<double> gap = gap_of(node.pose, move);
      if (!gap) continue;
      const double length_m = move.length_m > 0.0 ? move.length_m : kTurn_m;
      const double factor = 1.0 + 2.0 * std::max(1.0 - *gap / kNear_m, 0.0);
      reach({along_arc(node.pose, move.length_m, move.turn * kStep_rad),
             (node.heading + move.turn + kHeadings) % kHeadings, node.cost + factor * length_m, i});
    }
  }

  std::vector<Pose2> way_to(int i) const {
    std::vector<Pose2> way;
    for (; i != -1; i = nodes_[static_cast<std::size_t>(i)].from) {
      way.push_back(nodes_[static_cast<std::size_t>(i)].pose);
    }
    std::reverse(way.begin(), way.end());
    return way;
  }

  const DetourPlanner& planner_;
  const FloorMap& floor_;
  const std::vector<Pose2>& goals_;
  Pose2 start_;
  double keep_m_ = 0.0;
  std::vector<Node> nodes_;
  std::vector<int> best_;  ///< by cell: the node, or kNone
  using Entry = std::pair<double, int>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open_;
};

DetourPlanner::DetourPlanner(const Config& config)
    : config_(config),
      outline_(rim(config.rear_m, config.front_m, config.half_width_m)),
      longer_(rim(config.rear_m, config.front_m + std::max(config.ahead_m - config.gap_m, 0.0),
                  config.half_width_m)),
      wider_(rim(config.rear_m, config.front_m, config.half_width_m + config.side_m)) {}

std::optional<std::vector<Pose2>> DetourPlanner::plan(const FloorMap& floor, const Pose2& start,
                                                      const std::vector<Pose2>& goals) const {
  if (goals.empty()) return std::nullopt;
  return Search(*this, floor, start, goals).run(expansions_);
}

Room DetourPlanner::room(const FloorMap& floor, const Pose2& pose) const {
  return {gap_m(floor, outline_, pose), gap_m(floor, longer_, pose)};
}

bool DetourPlanner::is_free(const FloorMap& floor, const Pose2& pose) const {
  return gap_m(floor, outline_, pose) >= config_.gap_m;
}

}  // namespace tether
