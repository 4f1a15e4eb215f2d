#include "controller/detour/floor_map.hpp"

#include <algorithm>
#include <cmath>

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

}  // namespace tether
