#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/base/errors.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/key_table.hpp"
#include "common/world/obstacle_list.hpp"
#include "common/world/obstacle_shape.hpp"
#include "common/world/occupancy_map.hpp"
#include "common/world/surroundings.hpp"

namespace tether {
namespace {

constexpr double kTouch_m = 1e-6;

/// A shape with what messages call it.
struct NamedShape {
  std::string name;
  Shape shape;
  bool mapped = true;
};

OccupancyMap map_of(const Surroundings& surroundings, const std::string& file) {
  try {
    return load_occupancy_map(surroundings.map_file);
  } catch (const UsageError& error) {
    throw UsageError(fmt::format("{}: map.file: {}", file, error.what()));
  }
}

/// `cells`: of the map, if there is one.
std::vector<NamedShape> named_shapes(const Surroundings& surroundings,
                                     const std::vector<Shape>& cells) {
  std::vector<NamedShape> shapes;
  for (const Obstacle& obstacle : surroundings.obstacles) {
    const std::string name = fmt::format("[[world.obstacle]] {}", shapes.size() + 1);
    shapes.push_back({name, shape_of(obstacle), obstacle.mapped});
  }
  for (const Shape& shape : cells) {
    shapes.push_back({fmt::format("what map.file = \"{}\" shows", surroundings.map_file), shape});
  }
  return shapes;
}

/// The largest |x| or |y| that it reaches.
double reach_m(const Shape& shape) {
  if (shape.outline == Shape::Outline::circle) {
    return std::max(std::abs(shape.pose.x_m), std::abs(shape.pose.y_m)) + shape.radius_m;
  }
  double reach = 0.0;
  for (const Position& p : corners(shape)) {
    reach = std::max({reach, std::abs(p.x_m), std::abs(p.y_m)});
  }
  return reach;
}

/// From its centre.
double radius_m(const Shape& shape) {
  if (shape.outline == Shape::Outline::circle) return shape.radius_m;
  return 0.5 * std::hypot(shape.length_m, shape.width_m);
}

/// `or_else`: what else may be wrong.
void check_within_hall(const NamedShape& named, double half_extent_m, const std::string& file,
                       const std::string& or_else = "") {
  const double reach = reach_m(named.shape);
  if (reach <= half_extent_m + kTouch_m) return;
  throw UsageError(fmt::format(
      "{}: {} at ({}, {}) m is in or beyond a wall: it reaches {:.2f} m and must be "
      "within ±{} m (world.half_extent_m){}",
      file, named.name, named.shape.pose.x_m, named.shape.pose.y_m, reach, half_extent_m, or_else));
}

/// Possible error in the map's own file if it does not fit into the hall.
std::string wrong_in(const OccupancyMap& map, const std::vector<Shape>& cells,
                     const std::string& map_file, double half_extent_m) {
  constexpr double kSteps = 1e4, kRounding = 1e-6;
  const double fits_m =
      std::floor(kSteps * largest_resolution_m(map, cells, half_extent_m) + kRounding) / kSteps;
  const std::string what =
      fits_m > 0.0
          ? fmt::format("resolution = {} is wrong: at most {} fits", map.resolution_m, fits_m)
          : fmt::format("origin = [{}, {}, …] is wrong: with it no resolution fits", map.origin.x_m,
                        map.origin.y_m);
  return fmt::format(", or in {} {}", map_file, what);
}

void check_ways(const Surroundings& surroundings, double half_extent_m, const std::string& file) {
  for (std::size_t i = 0; i < surroundings.obstacles.size(); ++i) {
    Obstacle there = surroundings.obstacles[i];
    for (const Position& place : surroundings.obstacles[i].to) {
      there.pose.x_m = place.x_m;
      there.pose.y_m = place.y_m;
      check_within_hall({fmt::format("[[world.obstacle]] {}", i + 1), shape_of(there)},
                        half_extent_m, file);
    }
  }
}

/// How near the vehicle's outline a gap_m() is at least.
double gap_to_vehicle_m(const VehicleConfig& vehicle, const Pose2& axle, const Shape& shape) {
  double gap = std::numeric_limits<double>::infinity();
  for (const Shape& part : footprint(vehicle, axle)) gap = std::min(gap, gap_m(part, shape));
  return gap;
}

void check_start(const NamedShape& named, const VehicleSettings& vehicle, const std::string& file) {
  const double gap = gap_to_vehicle_m(
      vehicle, {vehicle.start_x_m, vehicle.start_y_m, vehicle.start_yaw_rad}, named.shape);
  const double off_m = kStartErrorSigmas * (std::numbers::sqrt2 * vehicle.start_error_m +
                                            reach_m(vehicle) * vehicle.start_error_rad);
  if (gap > off_m) return;
  throw UsageError(fmt::format(
      "{}: the vehicle starts at ({}, {}) m, {}: {} at ({}, {}) m; there must be more than {:.2f} "
      "m between them (vehicle.start_x_m, start_y_m, start_error_m, start_error_rad)",
      file, vehicle.start_x_m, vehicle.start_y_m,
      gap > 0.0 ? fmt::format("{:.2f} m from an obstacle", gap) : "in an obstacle", named.name,
      named.shape.pose.x_m, named.shape.pose.y_m, off_m));
}

void check_path(const Scenario& scenario, const std::vector<NamedShape>& shapes,
                const std::string& file) {
  VehicleConfig vehicle = scenario.get<VehicleSettings>();
  const auto& settings = scenario.get<PathSettings>();
  if (settings.point == PathSettings::Point::chassis) vehicle.axle_x_m = 0.0;
  const auto path = plan_path(settings);
  if (!path) return;
  const double vehicle_m = reach_m(vehicle);
  for (const SpeedProfile::Motion& step : path->profile().steps()) {
    const PathPoint at = path->point(step);
    for (const NamedShape& named : shapes) {
      const Pose2& pose = named.shape.pose;
      const double reach = radius_m(named.shape) + vehicle_m;
      const double dx = pose.x_m - at.x_m, dy = pose.y_m - at.y_m;
      if (!named.mapped || dx * dx + dy * dy > reach * reach ||
          gap_to_vehicle_m(vehicle, {at.x_m, at.y_m, at.yaw_rad}, named.shape) >= 0.0) {
        continue;
      }
      const std::string source = path->curve().source(step.s_m);
      throw UsageError(fmt::format(
          "{}: {:.2f} m along the path, at ({:.2f}, {:.2f}) m, the vehicle would be in {} at ({}, "
          "{}) m; the path must lead past what is in the map (mapped = false: it may be in the "
          "way)",
          source.empty() ? file : source, step.s_m, at.x_m, at.y_m, named.name, pose.x_m,
          pose.y_m));
    }
  }
}

void check(const Scenario& scenario, const std::string& file) {
  const auto& surroundings = scenario.get<Surroundings>();
  const double half_extent_m = scenario.get<WorldSettings>().half_extent_m;
  std::vector<Shape> cells;
  std::string or_else;
  if (!surroundings.map_file.empty()) {
    const OccupancyMap map = map_of(surroundings, file);
    cells = occupied_shapes(map);
    or_else = wrong_in(map, cells, surroundings.map_file, half_extent_m);
  }
  const std::vector<NamedShape> shapes = named_shapes(surroundings, cells);
  if (shapes.empty()) return;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const bool of_map = i >= surroundings.obstacles.size();
    check_within_hall(shapes[i], half_extent_m, file, of_map ? or_else : "");
  }
  for (const NamedShape& named : shapes) {
    check_start(named, scenario.get<VehicleSettings>(), file);
  }
  check_ways(surroundings, half_extent_m, file);
  check_path(scenario, shapes, file);
}

}  // namespace

ScenarioSection surroundings_section() {
  KeyTable<Surroundings> t("map.");
  t.file("file", &Surroundings::map_file,
         "occupancy map, YAML and PGM in the format of map_server; its occupied cells are "
         "obstacles in the hall");
  ScenarioSection section{.defaults = Surroundings{}, .keys = t.take()};
  section.list = obstacle_list();
  section.help = obstacle_help();
  section.check = check;
  return section;
}

}  // namespace tether
