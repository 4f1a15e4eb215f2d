#include "common/world/obstacle_list.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/scenario/key_table.hpp"
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

}  // namespace

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

}  // namespace tether
