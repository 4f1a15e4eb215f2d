#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/path/kinds.hpp"
#include "common/path/path_settings.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/section.hpp"
#include "common/world/occupancy_map.hpp"
#include "common/world/surroundings.hpp"

namespace tether {
namespace {

using Kind = Obstacle::Kind;
using Table = TableList::Table;

constexpr const char* kKey = "world.obstacle";
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kSamePlace_m = 0.01;
constexpr Range kPlace{-1e4, 1e4, false};
constexpr Range kSize{0.01, 1e4, false};

struct KindRow {
  const char* name;
  Kind kind;
  Obstacle defaults;
};

const std::array<KindRow, 4>& kinds() {
  static const std::array<KindRow, 4> rows{
      {{"box", Kind::box, {.kind = Kind::box}},
       {"cylinder", Kind::cylinder, {.kind = Kind::cylinder}},
       {"wall", Kind::wall, {.kind = Kind::wall, .width_m = 0.2, .height_m = 2.5}},
       {"rack",
        Kind::rack,
        {.kind = Kind::rack, .length_m = kRackBay_m, .width_m = 1.1, .height_m = 4.0}}}};
  return rows;
}

const KindRow& row_of(Kind kind) { return kinds()[static_cast<std::size_t>(kind)]; }

bool for_all(const Obstacle&) { return true; }
bool is_angular(const Obstacle& o) { return o.kind != Kind::cylinder; }
bool is_round(const Obstacle& o) { return o.kind == Kind::cylinder; }
bool may_move(const Obstacle& o) { return o.kind == Kind::box || o.kind == Kind::cylinder; }

struct NumberKey {
  const char* name;
  Range range;
  double& (*of)(Obstacle&);
  bool (*has)(const Obstacle&);
  bool of_motion = false;
};

const std::array<NumberKey, 11>& number_keys() {
  static const std::array<NumberKey, 11> keys{{
      {"x_m", kPlace, [](Obstacle& o) -> double& { return o.pose.x_m; }, for_all},
      {"y_m", kPlace, [](Obstacle& o) -> double& { return o.pose.y_m; }, for_all},
      {"yaw_rad",
       {-100.0, 100.0, false},
       [](Obstacle& o) -> double& { return o.pose.yaw_rad; },
       is_angular},
      {"length_m", kSize, [](Obstacle& o) -> double& { return o.length_m; }, is_angular},
      {"width_m", kSize, [](Obstacle& o) -> double& { return o.width_m; }, is_angular},
      {"radius_m", kSize, [](Obstacle& o) -> double& { return o.radius_m; }, is_round},
      {"height_m",
       {0.01, 100.0, false},
       [](Obstacle& o) -> double& { return o.height_m; },
       for_all},
      {"reflectivity", kRatio, [](Obstacle& o) -> double& { return o.reflectivity; }, for_all},
      {"speed_mps",
       {0.01, 5.0, false},
       [](Obstacle& o) -> double& { return o.speed_mps; },
       may_move,
       true},
      {"speed_variation",
       {0.0, 0.9, false},
       [](Obstacle& o) -> double& { return o.speed_variation; },
       may_move,
       true},
      {"pause_s",
       {0.0, 1e4, false},
       [](Obstacle& o) -> double& { return o.pause_s; },
       may_move,
       true},
  }};
  return keys;
}

std::vector<std::string> key_names(const Obstacle& obstacle) {
  std::vector<std::string> names{"kind", "mapped"};
  if (is_angular(obstacle)) names.emplace_back("yaw_deg");
  if (may_move(obstacle)) names.emplace_back("to");
  for (const NumberKey& key : number_keys()) {
    if (key.has(obstacle)) names.emplace_back(key.name);
  }
  return names;
}

/// Reads one [[world.obstacle]]; `place` begins its errors.
class ObstacleReader {
 public:
  ObstacleReader(const Table& table, std::string place) : table_(table), place_(std::move(place)) {}

  Obstacle read() {
    read_kind();
    read_numbers();
    read_yaw_deg();
    if (const auto* mapped = find("mapped")) {
      const auto* value = std::get_if<bool>(mapped);
      if (value == nullptr) refuse("mapped", "must be true or false");
      obstacle_.mapped = *value;
    }
    read_motion();
    refuse_unknown();
    return obstacle_;
  }

 private:
  const ScenarioValue* find(const std::string& key) const {
    const auto found = table_.find(key);
    return found == table_.end() ? nullptr : &found->second;
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw UsageError(fmt::format("{}: {}", place_, what));
  }
  [[noreturn]] void refuse(const std::string& key, const std::string& allowed) const {
    fail(fmt::format("{} = {} is not allowed: {}", key,
                     printable(to_toml(*find(key)), kLongestValueShown), allowed));
  }

  void read_kind() {
    const auto* value = find("kind");
    if (value == nullptr) return;
    std::vector<std::string> names;
    for (const KindRow& row : kinds()) {
      if (*value == ScenarioValue(std::string(row.name))) {
        obstacle_ = row.defaults;
        return;
      }
      names.push_back(fmt::format("\"{}\"", row.name));
    }
    refuse("kind", fmt::format("must be one of {}", fmt::join(names, ", ")));
  }

  void read_numbers() {
    for (const NumberKey& key : number_keys()) {
      const auto* value = find(key.name);
      if (value == nullptr || !key.has(obstacle_)) continue;
      const auto number = number_of(*value);
      if (!number || !key.range.contains(*number)) {
        refuse(key.name, "must be " + key.range.text("number"));
      }
      key.of(obstacle_) = *number;
    }
    for (const char* required : {"x_m", "y_m"}) {
      if (find(required) == nullptr) {
        fail(fmt::format("{} is missing: must be {}", required, kPlace.text("number")));
      }
    }
    obstacle_.pose.yaw_rad = wrap_angle(obstacle_.pose.yaw_rad);
  }

  void read_yaw_deg() {
    const auto* value = find("yaw_deg");
    if (value == nullptr || !is_angular(obstacle_)) return;
    if (find("yaw_rad") != nullptr) fail("yaw_deg and yaw_rad are both given: give one of them");
    constexpr Range kTurn{-360.0, 360.0, false};
    const auto yaw_deg = number_of(*value);
    if (!yaw_deg || !kTurn.contains(*yaw_deg)) refuse("yaw_deg", "must be " + kTurn.text("number"));
    obstacle_.pose.yaw_rad = wrap_angle(*yaw_deg * kDegree);
  }

  void read_motion() {
    const auto* value = find("to");
    if (value != nullptr && may_move(obstacle_)) read_places(*value);
    for (const NumberKey& key : number_keys()) {
      if (key.of_motion && key.has(obstacle_) && !obstacle_.moves() && find(key.name) != nullptr) {
        fail(fmt::format("{} has no effect: it stands; to = [[x, y], ...] says where it goes",
                         key.name));
      }
    }
    if (!obstacle_.moves()) return;
    if (find("mapped") != nullptr && obstacle_.mapped) {
      refuse("mapped", "what moves is in no map: must be false, or not be given");
    }
    obstacle_.mapped = false;
  }

  void read_places(const ScenarioValue& value) {
    const std::string allowed = fmt::format(
        "must be a list of one place [x, y] or more, within ±{} m, each at least {} m from the one "
        "before, the first from x_m, y_m and the last, too",
        kPlace.high, kSamePlace_m);
    const auto* rows = std::get_if<NumberRows>(&value);
    if (rows == nullptr || rows->empty()) refuse("to", allowed);
    const Position start{obstacle_.pose.x_m, obstacle_.pose.y_m};
    Position last = start;
    const auto is_near = [](const Position& a, const Position& b) {
      return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) < kSamePlace_m;
    };
    for (const NumberList& row : *rows) {
      if (row.size() != 2 || !kPlace.contains(row[0]) || !kPlace.contains(row[1])) {
        refuse("to", allowed);
      }
      const Position next{row[0], row[1]};
      if (is_near(last, next)) refuse("to", allowed);
      obstacle_.to.push_back(last = next);
    }
    if (is_near(last, start)) refuse("to", allowed);
  }

  void refuse_unknown() const {
    const auto names = key_names(obstacle_);
    for (const auto& [key, value] : table_) {
      if (std::find(names.begin(), names.end(), key) != names.end()) continue;
      fail(fmt::format("unknown key \"{}\": a {} has {}", printable(key, kLongestValueShown),
                       row_of(obstacle_.kind).name, fmt::join(names, ", ")));
    }
  }

  const Table& table_;
  std::string place_;
  Obstacle obstacle_;
};

bool read_obstacles(Scenario& scenario, const std::vector<Table>& tables,
                    const std::string& place) {
  std::vector<Obstacle> obstacles;
  for (const Table& table : tables) {
    const std::string its_place = fmt::format("{}: [[{}]] {}", place, kKey, obstacles.size() + 1);
    obstacles.push_back(ObstacleReader(table, its_place).read());
  }
  scenario.get<Surroundings>().obstacles = std::move(obstacles);
  return true;
}

std::string to_toml_text(Obstacle obstacle) {
  std::string text = fmt::format("\n[[{}]]\nkind = \"{}\"\n", kKey, row_of(obstacle.kind).name);
  for (const NumberKey& key : number_keys()) {
    if (!key.has(obstacle) || (key.of_motion && !obstacle.moves())) continue;
    text += fmt::format("{} = {}\n", key.name, to_toml(ScenarioValue(key.of(obstacle))));
  }
  if (!obstacle.moves()) return text + fmt::format("mapped = {}\n", obstacle.mapped);
  NumberRows places;
  for (const Position& place : obstacle.to) places.push_back({place.x_m, place.y_m});
  return text + fmt::format("to = {}\n", to_toml(ScenarioValue(places)));
}

std::string to_toml_text(const Scenario& scenario) {
  std::string text;
  for (const Obstacle& obstacle : scenario.get<Surroundings>().obstacles) {
    text += to_toml_text(obstacle);
  }
  return text;
}

/// [[world.obstacle]]: the obstacles of Surroundings.
TableList obstacle_list() {
  return {.key = kKey,
          .allowed = fmt::format("{0} must be a list of tables, [[{0}]]", kKey),
          .read = read_obstacles,
          .to_toml = [](const Scenario& scenario) { return to_toml_text(scenario); }};
}

std::string obstacle_help() {
  std::string defaults;
  for (const KindRow& row : kinds()) {
    const Obstacle& o = row.defaults;
    const std::string size =
        is_round(o) ? fmt::format("radius_m = {}", o.radius_m)
                    : fmt::format("length_m = {}, width_m = {}", o.length_m, o.width_m);
    defaults += fmt::format("    {}: {}, height_m = {}\n", row.name, size, o.height_m);
  }
  const Obstacle o;
  return fmt::format(
      "[[{}]] kind = \"box\", \"cylinder\", \"wall\" or \"rack\", x_m, y_m, yaw_deg or yaw_rad = "
      "0, reflectivity = {}, mapped = true\n"
      "    obstacle in the hall; mapped: in the map of localisers and planners. Sizes by "
      "default:\n{}"
      "    to = [[x, y], ...], speed_mps = {}, speed_variation = {}, pause_s = {}: a box or "
      "cylinder that moves there and back repeatedly\n",
      kKey, o.reflectivity, defaults, o.speed_mps, o.speed_variation, o.pause_s);
}

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
