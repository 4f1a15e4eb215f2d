#include "tools/experiment/sweep/grid.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/loader.hpp"

namespace tether {
namespace {

constexpr std::size_t kMostValues = 100'000;

std::string place_of(const toml::node& node, const std::string& file) {
  return fmt::format("{}:{}", file, node.source().begin.line);
}

/// A table that says which values a key may have.
bool is_range(const toml::node& node) {
  const auto* table = node.as_table();
  return table != nullptr && (table->contains("from") || table->contains("choices"));
}

void flatten_into(const toml::table& table, const std::string& prefix, const std::string& file,
                  std::vector<PlacedNode>& out) {
  for (const auto& [name, node] : table) {
    const std::string key = prefix + std::string(name.str());
    if (const auto* inner = node.as_table(); inner != nullptr && !is_range(node)) {
      flatten_into(*inner, key + ".", file, out);
    } else {
      out.push_back({key, &node, place_of(node, file)});
    }
  }
}

bool is_before(const PlacedNode& a, const PlacedNode& b) {
  const auto position = [](const PlacedNode& n) {
    const toml::source_position begin = n.node->source().begin;
    return std::pair(begin.line, begin.column);
  };
  return position(a) < position(b);
}

std::set<std::string> meant_by(const std::string& key) {
  const auto keys = ScenarioSchema::all()->keys_meant_by(key);
  return {keys.begin(), keys.end()};
}

/// { from, to, step } or { from, to, count }.
std::vector<std::string> range_values(const PlacedNode& given) {
  const toml::table& table = *given.node->as_table();
  const auto number = [&table](const char* name) {
    const toml::node* node = table.get(name);
    return node != nullptr && node->is_number() ? node->value<double>() : std::nullopt;
  };
  const auto from = number("from"), to = number("to"), step = number("step"),
             count = number("count");
  double steps = -1.0;
  if (step) steps = std::floor((*to - *from) / *step + 1e-9);
  if (count) steps = *count - 1.0;
  const bool is_good = table.size() == 3 && from && to && (step || count) && *from != *to &&
                       steps >= 1.0 && steps < static_cast<double>(kMostValues) &&
                       (!count || *count == std::floor(*count));
  if (!is_good) {
    throw UsageError(fmt::format(
        "{}: {} must be a list of values, or {{ from, to, step }} or {{ from, to, count }} with "
        "numbers that give 2 to {} values",
        given.place, given.key, kMostValues));
  }
  const double width = count ? (*to - *from) / steps : *step;
  std::vector<std::string> values;
  for (int i = 0; i <= static_cast<int>(steps); ++i) {
    // Rounded, so that steps of 0.1 give 0.3 and not 0.30000000000000004.
    values.push_back(fmt::format("{:.12g}", *from + i * width));
  }
  return values;
}

std::vector<std::string> values_of(const PlacedNode& given) {
  if (is_range(*given.node)) return range_values(given);
  const auto* list = given.node->as_array();
  if (list == nullptr || list->empty()) {
    throw UsageError(fmt::format("{}: {} must be a list of one value or more, or a range",
                                 given.place, given.key));
  }
  std::vector<std::string> values;
  for (const toml::node& value : *list) values.push_back(value_text(value));
  return values;
}

Axis make_axis(const std::vector<PlacedNode>& keys, const std::string& place) {
  Axis axis{{}, {}, place};
  for (const PlacedNode& key : keys) {
    const std::vector<std::string> values = values_of(key);
    if (axis.keys.empty()) axis.points.resize(values.size());
    if (values.size() != axis.points.size()) {
      throw UsageError(
          fmt::format("{}: {} has {} values, but {} of the same [[zip]] has {}: keys that go "
                      "together need lists of one length",
                      key.place, key.key, values.size(), axis.keys.front(), axis.points.size()));
    }
    axis.keys.push_back(key.key);
    for (std::size_t i = 0; i < values.size(); ++i) {
      axis.points[i].settings.push_back({key.key, values[i]});
      axis.points[i].applied.push_back({{key.key, values[i]}, place});
    }
  }
  std::set<std::vector<std::string>> seen;
  for (const GridPoint& point : axis.points) {
    std::vector<std::string> values;
    for (const KeyValue& setting : point.settings) values.push_back(setting.value);
    if (seen.insert(values).second) continue;
    throw UsageError(fmt::format("{}: {} = {} is there twice", keys.front().place,
                                 axis.keys.front(), values.front()));
  }
  return axis;
}

/// Settings of a named axis' point.
GridPoint named_point(const std::string& axis, const PlacedNode& given, const std::string& file,
                      const Expand& expand) {
  const toml::table* table = given.node->as_table();
  if (table == nullptr) {
    throw UsageError(fmt::format("{}: axis.{}.\"{}\" must be a table of scenario keys", given.place,
                                 axis, given.key));
  }
  return {{{axis, "\"" + given.key + "\""}}, settings_in(*table, file, expand)};
}

/// [axis.NAME]: tables by label, in the order of the file.
Axis named_axis(const std::string& name, const toml::node& node, const std::string& file,
                const Expand& expand) {
  const toml::table* labels = node.as_table();
  if (!is_identifier(name) || labels == nullptr || labels->empty()) {
    throw UsageError(fmt::format(
        "{}: write [axis.NAME.\"LABEL\"] for each point: a name of letters, digits, '-' and '_', "
        "and labels with tables of scenario keys",
        place_of(node, file)));
  }
  const std::vector<PlacedNode> points = entries(*labels, file);
  Axis axis{{name}, {}, points.front().place};
  for (const PlacedNode& point : points) {
    axis.points.push_back(named_point(name, point, file, expand));
  }
  return axis;
}

/// Full names of scenario keys, and as what the file has them.
using SetKeys = std::map<std::string, std::string>;

void set_once(SetKeys& keys, const std::string& meant, const std::string& key,
              const std::string& place) {
  const auto [other, is_new] = keys.emplace(meant, key);
  if (is_new) return;
  throw UsageError(
      fmt::format("{}: {} is varied twice{}", place, meant,
                  other->second == key ? "" : fmt::format(" (by {} and {})", other->second, key)));
}

/// Two settings of one key would fight.
void check_once(const std::vector<Axis>& axes) {
  SetKeys all;
  for (const Axis& axis : axes) {
    SetKeys of_axis;
    for (const GridPoint& point : axis.points) {
      SetKeys of_point;
      for (const auto& [setting, place] : point.applied) {
        for (const std::string& meant : ScenarioSchema::all()->keys_meant_by(setting.key)) {
          set_once(of_point, meant, setting.key, place);
        }
      }
      of_axis.merge(of_point);
    }
    for (const auto& [meant, key] : of_axis) set_once(all, meant, key, axis.place);
  }
}

toml::source_index line_of(const Axis& axis) {
  return static_cast<toml::source_index>(std::stoul(axis.place.substr(axis.place.rfind(':') + 1)));
}

void check_part_keys(const toml::table& part, const std::string& file) {
  for (const auto& [key, node] : part) {
    if (key == "set" || key == "grid" || key == "zip" || key == "axis") continue;
    throw UsageError(fmt::format("{}: unknown key \"part.{}\"; allowed: axis, grid, set, zip",
                                 place_of(node, file), key.str()));
  }
}

/// [set], with places.
void add_settings(const toml::table& table, const std::string& file, const Expand& expand,
                  std::vector<PlacedSetting>& settings) {
  const toml::node* set = table.get("set");
  if (set == nullptr) return;
  if (!set->is_table()) {
    throw UsageError(fmt::format("{}: set must be a table, [set]", place_of(*set, file)));
  }
  for (PlacedSetting& setting : settings_in(*set->as_table(), file, expand)) {
    settings.push_back(std::move(setting));
  }
}

const toml::table* table_or_refuse(const toml::node& node, const std::string& file,
                                   const std::string& what) {
  const auto* table = node.as_table();
  if (table != nullptr && !table->empty()) return table;
  throw UsageError(fmt::format("{}: {} must be a table of scenario keys with lists of values",
                               place_of(node, file), what));
}

}  // namespace

std::vector<PlacedNode> flatten(const toml::table& table, const std::string& file) {
  std::vector<PlacedNode> nodes;
  flatten_into(table, "", file, nodes);
  std::sort(nodes.begin(), nodes.end(), is_before);
  return nodes;
}

std::vector<PlacedNode> entries(const toml::table& table, const std::string& file) {
  std::vector<PlacedNode> nodes;
  for (const auto& [key, node] : table) {
    nodes.push_back({std::string(key.str()), &node, place_of(node, file)});
  }
  std::sort(nodes.begin(), nodes.end(), is_before);
  return nodes;
}

std::vector<PlacedSetting> settings_in(const toml::table& table, const std::string& file,
                                       const Expand& expand) {
  std::set<std::string> own;
  const std::vector<PlacedNode> nodes = flatten(table, file);
  for (const PlacedNode& given : nodes) own.merge(meant_by(given.key));
  std::vector<PlacedSetting> settings;
  for (const PlacedNode& given : nodes) {
    for (const auto& meant : expand({{given.key, value_text(*given.node)}, given.place})) {
      const std::set<std::string> keys = meant_by(meant.setting.key);
      const bool is_beaten = meant.setting.key != given.key &&
                             std::any_of(keys.begin(), keys.end(),
                                         [&own](const auto& key) { return own.contains(key); });
      if (!is_beaten) settings.push_back(meant);
    }
  }
  return settings;
}

std::string value_text(const toml::node& node) {
  if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
  if (const auto* list = node.as_array()) {
    std::string text;
    for (const toml::node& entry : *list) text += (text.empty() ? "" : ", ") + value_text(entry);
    return "[" + text + "]";
  }
  std::ostringstream out;
  out << toml::node_view<const toml::node>(&node);
  return out.str();
}

std::vector<Axis> read_axes(const toml::table& experiment, const std::string& file,
                            const Expand& expand) {
  std::vector<std::pair<toml::source_index, Axis>> placed;  // with their lines
  if (const toml::node* grid = experiment.get("grid")) {
    for (const PlacedNode& key : flatten(*table_or_refuse(*grid, file, "[grid]"), file)) {
      placed.emplace_back(key.node->source().begin.line, make_axis({key}, key.place));
    }
  }
  if (const toml::node* zips = experiment.get("zip")) {
    const auto* list = zips->as_array();
    if (list == nullptr || list->empty()) {
      throw UsageError(
          fmt::format("{}: write [[zip]], a table for each set of keys", place_of(*zips, file)));
    }
    for (const toml::node& zip : *list) {
      placed.emplace_back(
          zip.source().begin.line,
          make_axis(flatten(*table_or_refuse(zip, file, "[[zip]]"), file), place_of(zip, file)));
    }
  }
  if (const toml::node* named = experiment.get("axis")) {
    for (const auto& [name, node] : *table_or_refuse(*named, file, "[axis]")) {
      Axis axis = named_axis(std::string(name.str()), node, file, expand);
      placed.emplace_back(line_of(axis), std::move(axis));
    }
  }
  std::stable_sort(placed.begin(), placed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Axis> axes;
  for (auto& [line, axis] : placed) axes.push_back(std::move(axis));
  check_once(axes);
  return axes;
}

std::vector<Part> read_parts(const toml::table& experiment, const std::string& file,
                             const Expand& expand) {
  Part common{{}, read_axes(experiment, file, expand)};
  add_settings(experiment, file, expand, common.settings);
  const toml::node* parts = experiment.get("part");
  if (parts == nullptr) return {common};
  const auto* list = parts->as_array();
  if (list == nullptr || list->empty()) {
    throw UsageError(fmt::format("{}: write [[part]], a table for each", place_of(*parts, file)));
  }
  std::vector<Part> result;
  for (const toml::node& node : *list) {
    const toml::table& table = *table_or_refuse(node, file, "[[part]]");
    check_part_keys(table, file);
    Part part = common;
    add_settings(table, file, expand, part.settings);
    for (Axis& own : read_axes(table, file, expand)) {
      const auto same = std::find_if(part.axes.begin(), part.axes.end(),
                                     [&own](const Axis& axis) { return axis.keys == own.keys; });
      if (same == part.axes.end()) {
        part.axes.push_back(std::move(own));
      } else {
        *same = std::move(own);
      }
    }
    check_once(part.axes);
    result.push_back(std::move(part));
    const auto keys = keys_of(result.back().axes), first = keys_of(result.front().axes);
    if (keys == first) continue;
    throw UsageError(
        fmt::format("{}: varies {}, but the first part varies {}: all parts need the same keys in "
                    "the same order",
                    place_of(node, file), fmt::join(keys, ", "), fmt::join(first, ", ")));
  }
  return result;
}

std::vector<std::string> keys_of(const std::vector<Axis>& axes) {
  std::vector<std::string> keys;
  for (const Axis& axis : axes) keys.insert(keys.end(), axis.keys.begin(), axis.keys.end());
  return keys;
}

std::vector<GridPoint> cross(const std::vector<Axis>& axes) {
  std::vector<GridPoint> points(1);
  for (const Axis& axis : axes) {
    std::vector<GridPoint> longer;
    for (const GridPoint& begun : points) {
      for (const GridPoint& point : axis.points) {
        longer.push_back(begun);
        GridPoint& whole = longer.back();
        whole.settings.insert(whole.settings.end(), point.settings.begin(), point.settings.end());
        whole.applied.insert(whole.applied.end(), point.applied.begin(), point.applied.end());
      }
    }
    points = std::move(longer);
    if (points.size() > kMostValues) {
      throw UsageError(fmt::format("{}: more than {} combinations", axis.place, kMostValues));
    }
  }
  return points;
}

}  // namespace tether
