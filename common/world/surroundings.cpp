#include "common/world/surroundings.hpp"

#include <cmath>

#include "common/world/obstacle_shape.hpp"
#include "common/world/occupancy_map.hpp"

namespace tether {
namespace {

constexpr double kWallThickness_m = 0.2;
constexpr double kWallHeight_m = 2.5;

/// They stand outside: their inner sides are where plants have them.
std::vector<Shape> four_walls(const WorldSettings& world) {
  const double middle_m = world.half_extent_m + 0.5 * kWallThickness_m;
  const double length_m = 2.0 * (world.half_extent_m + kWallThickness_m);
  Shape wall{.length_m = length_m, .width_m = kWallThickness_m, .height_m = kWallHeight_m};
  std::vector<Shape> walls;
  for (const double side : {1.0, -1.0}) {
    wall.pose = {0.0, side * middle_m, 0.0};
    walls.push_back(wall);
  }
  std::swap(wall.length_m, wall.width_m);
  for (const double side : {1.0, -1.0}) {
    wall.pose = {side * middle_m, 0.0, 0.0};
    walls.push_back(wall);
  }
  return walls;
}

void add_posts(const Obstacle& rack, std::vector<Shape>& out) {
  const double length_m = std::min(kRackPost_m, rack.length_m);
  const double width_m = std::min(kRackPost_m, rack.width_m);
  const double c = std::cos(rack.pose.yaw_rad), s = std::sin(rack.pose.yaw_rad);
  const double span_m = rack.length_m - length_m;
  const int bays = std::max(1, static_cast<int>(std::ceil(span_m / kRackBay_m - 1e-9)));
  for (int i = 0; i <= bays; ++i) {
    const double x = span_m * (static_cast<double>(i) / bays - 0.5);
    for (const double side : {1.0, -1.0}) {
      const double y = side * 0.5 * (rack.width_m - width_m);
      Shape post = shape_of(rack);
      post.pose.x_m += c * x - s * y;
      post.pose.y_m += s * x + c * y;
      post.length_m = length_m;
      post.width_m = width_m;
      post.clearance_m = 0.0;
      out.push_back(post);
    }
  }
}

void add_cells(const Surroundings& surroundings, std::vector<Shape>& out) {
  if (surroundings.map_file.empty()) return;
  const std::vector<Shape> cells = occupied_shapes(load_occupancy_map(surroundings.map_file));
  out.insert(out.end(), cells.begin(), cells.end());
}

/// Shapes of the standing obstacles for which `Wanted` is true, and of the map's cells.
template <class Wanted>
std::vector<Shape> shapes_of(const Surroundings& surroundings, Wanted wanted) {
  std::vector<Shape> shapes;
  for (const Obstacle& obstacle : surroundings.obstacles) {
    if (obstacle.moves() || !wanted(obstacle)) continue;
    shapes.push_back(shape_of(obstacle));
    if (obstacle.kind == Obstacle::Kind::rack) add_posts(obstacle, shapes);
  }
  add_cells(surroundings, shapes);
  return shapes;
}

std::vector<Shape> within_walls(const HallSettings& settings, const std::vector<Shape>& inside) {
  std::vector<Shape> shapes = four_walls(settings.get<WorldSettings>());
  shapes.insert(shapes.end(), inside.begin(), inside.end());
  return shapes;
}

}  // namespace

Shape shape_of(const Obstacle& obstacle) {
  Shape shape{.pose = obstacle.pose,
              .length_m = obstacle.length_m,
              .width_m = obstacle.width_m,
              .radius_m = obstacle.radius_m,
              .height_m = obstacle.height_m};
  if (obstacle.kind == Obstacle::Kind::cylinder) shape.outline = Shape::Outline::circle;
  if (obstacle.kind == Obstacle::Kind::rack) {
    shape.clearance_m = std::min(kShelfClearance_m, 0.5 * obstacle.height_m);
  }
  shape.reflectivity = obstacle.reflectivity;
  return shape;
}

std::vector<Shape> obstacle_shapes(const Surroundings& surroundings) {
  return shapes_of(surroundings, [](const Obstacle&) { return true; });
}

std::vector<Shape> standing_shapes(const HallSettings& settings) {
  return within_walls(settings, obstacle_shapes(settings.get<Surroundings>()));
}

std::vector<Shape> mapped_shapes(const HallSettings& settings) {
  return within_walls(settings, shapes_of(settings.get<Surroundings>(),
                                          [](const Obstacle& o) { return o.mapped; }));
}

std::vector<Shape> solid_shapes(const Surroundings& surroundings) {
  std::vector<Shape> shapes;
  for (const Obstacle& obstacle : surroundings.obstacles) {
    if (!obstacle.moves()) shapes.push_back(shape_of(obstacle));
  }
  add_cells(surroundings, shapes);
  return shapes;
}

}  // namespace tether
