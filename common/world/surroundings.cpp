#include "common/world/surroundings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <cmath>

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

Position MovingObstacles::Walker::place(std::size_t i) const {
  return i == 0 ? Position{obstacle.pose.x_m, obstacle.pose.y_m} : obstacle.to[i - 1];
}

/// The way from `from` on, which begins at begin_s.
void MovingObstacles::Walker::plan() {
  const Position a = place(from), b = place((from + 1) % (obstacle.to.size() + 1));
  const double pause_s =
      obstacle.pause_s * boost::random::exponential_distribution<double>()(random);
  const double share = 1.0 + obstacle.speed_variation * (2.0 * uniform_01(random) - 1.0);
  const double way_s = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / (obstacle.speed_mps * share);
  depart_s = begin_s + pause_s;
  arrive_s = depart_s + way_s;
  vx_mps = (b.x_m - a.x_m) / way_s;
  vy_mps = (b.y_m - a.y_m) / way_s;
}

void MovingObstacles::Walker::seek(double t_s) {
  if (t_s < begin_s) {
    random = seeded;
    from = 0;
    begin_s = 0.0;
    plan();
  }
  while (t_s >= arrive_s) {
    from = (from + 1) % (obstacle.to.size() + 1);
    begin_s = arrive_s;
    plan();
  }
}

MovingObstacles::MovingObstacles(const Surroundings& surroundings, std::uint64_t seed) {
  for (std::size_t i = 0; i < surroundings.obstacles.size(); ++i) {
    const Obstacle& obstacle = surroundings.obstacles[i];
    if (!obstacle.moves()) continue;
    const RandomEngine random = random_stream(seed, fmt::format("world/obstacle/{}", i + 1));
    walkers_.push_back({.obstacle = obstacle, .seeded = random, .random = random});
    walkers_.back().plan();
    shapes_.push_back(shape_of(obstacle));
  }
}

double MovingObstacles::fastest_mps() const {
  double fastest = 0.0;
  for (const Walker& w : walkers_) {
    fastest = std::max(fastest, w.obstacle.speed_mps * (1.0 + w.obstacle.speed_variation));
  }
  return fastest;
}

const std::vector<Shape>& MovingObstacles::at(double t_s) {
  const double now_s = std::max(0.0, t_s);
  for (std::size_t i = 0; i < walkers_.size(); ++i) {
    Walker& w = walkers_[i];
    w.seek(now_s);
    Shape& shape = shapes_[i];
    const bool goes = now_s >= w.depart_s;
    const double way_s = goes ? now_s - w.depart_s : 0.0;
    const Position from = w.place(w.from);
    shape.pose.x_m = from.x_m + w.vx_mps * way_s;
    shape.pose.y_m = from.y_m + w.vy_mps * way_s;
    shape.vx_mps = goes ? w.vx_mps : 0.0;
    shape.vy_mps = goes ? w.vy_mps : 0.0;
  }
  return shapes_;
}

}  // namespace tether
