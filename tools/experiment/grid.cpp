#include "tools/experiment/grid.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <sstream>

#include "common/errors.hpp"
#include "common/scenario_loader.hpp"

namespace tether {
namespace {

constexpr std::size_t kMostValues = 100'000;

std::string place_of(const toml::node& node, const std::string& file) {
  return fmt::format("{}:{}", file, node.source().begin.line);
}

bool is_range(const toml::node& node) {
  const auto* table = node.as_table();
  return table != nullptr && table->contains("from");
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
      axis.points[i].push_back({key.key, values[i]});
    }
  }
  std::set<std::vector<std::string>> seen;
  for (const auto& point : axis.points) {
    std::vector<std::string> values;
    for (const KeyValue& setting : point) values.push_back(setting.value);
    if (seen.insert(values).second) continue;
    throw UsageError(fmt::format("{}: {} = {} is there twice", keys.front().place,
                                 axis.keys.front(), values.front()));
  }
  return axis;
}

/// Two settings of one key would fight.
void check_once(const std::vector<Axis>& axes) {
  std::map<std::string, std::string> owners;
  for (const Axis& axis : axes) {
    for (const std::string& key : axis.keys) {
      for (const std::string& meant : keys_meant_by(key)) {
        const auto [other, is_new] = owners.emplace(meant, key);
        if (is_new) continue;
        throw UsageError(fmt::format("{}: {} is varied twice{}", axis.place, meant,
                                     other->second == key
                                         ? std::string{}
                                         : fmt::format(" (by {} and {})", other->second, key)));
      }
    }
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

std::vector<Axis> read_axes(const toml::table& experiment, const std::string& file) {
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
  std::stable_sort(placed.begin(), placed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Axis> axes;
  for (auto& [line, axis] : placed) axes.push_back(std::move(axis));
  check_once(axes);
  return axes;
}

std::vector<std::vector<KeyValue>> cross(const std::vector<Axis>& axes) {
  std::vector<std::vector<KeyValue>> points(1);
  for (const Axis& axis : axes) {
    std::vector<std::vector<KeyValue>> longer;
    for (const auto& begun : points) {
      for (const auto& point : axis.points) {
        longer.push_back(begun);
        longer.back().insert(longer.back().end(), point.begin(), point.end());
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
