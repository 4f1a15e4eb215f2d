#include "autonomy/node/sighted_points.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "autonomy/field/swept_way.hpp"

namespace tether {

SightedPoints::SightedPoints(const std::vector<Shape>& mapped) {
  for (const Shape& shape : mapped) {
    const double reach_m = shape.outline == Shape::Outline::circle
                               ? shape.radius_m
                               : 0.5 * std::hypot(shape.length_m, shape.width_m);
    known_.push_back({shape, reach_m});
  }
}

bool SightedPoints::is_mapped(const Position& p) const {
  return std::any_of(known_.begin(), known_.end(), [&p](const Known& known) {
    const double within_m = known.reach_m + kMapped_m;
    return std::abs(p.x_m - known.shape.pose.x_m) < within_m &&
           std::abs(p.y_m - known.shape.pose.y_m) < within_m &&
           distance_m(known.shape, p) < kMapped_m;
  });
}

std::vector<Position> SightedPoints::unmapped(const std::vector<Position>& points,
                                              const Pose2& vehicle, std::size_t most) const {
  std::vector<Position> near;
  for (const Position& p : points) {
    if (p.x_m * p.x_m + p.y_m * p.y_m < kRange_m * kRange_m) near.push_back(p);
  }
  std::stable_sort(near.begin(), near.end(), [](const Position& a, const Position& b) {
    return a.x_m * a.x_m + a.y_m * a.y_m < b.x_m * b.x_m + b.y_m * b.y_m;
  });
  std::vector<Position> unmapped;
  std::set<std::pair<std::int64_t, std::int64_t>> taken;
  for (const Position& p : near) {
    if (unmapped.size() >= most) break;
    const Position world = from_frame(vehicle, p);
    const auto cell =
        std::pair{std::llround(world.x_m / kApart_m), std::llround(world.y_m / kApart_m)};
    if (!taken.contains(cell) && !is_mapped(world)) {
      taken.insert(cell);
      unmapped.push_back(world);
    }
  }
  return unmapped;
}

}  // namespace tether
