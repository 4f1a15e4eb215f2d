#pragma once

#include <toml++/toml.h>

#include <functional>
#include <string>
#include <vector>

#include "tools/experiment/sweep/experiment.hpp"

namespace tether {

/// A scenario key, what it is set to, and where the file says so: "file.toml:12".
struct PlacedSetting {
  KeyValue setting;
  std::string place;
};

/// One point of an axis, or of several.
struct GridPoint {
  std::vector<KeyValue> settings;      ///< its identity: keys and values, or name and label
  std::vector<PlacedSetting> applied;  ///< settings that it applies to the scenario
};

/// Keys that vary together, and their values; or a name and its labels.
struct Axis {
  std::vector<std::string> keys;  ///< a name has no dot
  std::vector<GridPoint> points;  ///< one value of each key
  std::string place;              ///< "file.toml:12"
};

/// Expansion of a setting of [set] or of a named axis' point: itself, or several.
using Expand = std::function<std::vector<PlacedSetting>(const PlacedSetting&)>;

/// The axes of [grid], each key one, of [[zip]], each table one, and of [axis.NAME], each name one,
/// in the file's order. Throws UsageError for values that are no list and no range, lists without
/// values, with a value twice or of different lengths within a zip, and keys given twice.
std::vector<Axis> read_axes(const toml::table& experiment, const std::string& file,
                            const Expand& expand);

/// A [[part]] of an experiment: the common settings and axes, and its own after them; an axis takes
/// the place of a common one of the same keys.
struct Part {
  std::vector<PlacedSetting> settings;  ///< settings of [set] and [part.set]
  std::vector<Axis> axes;
};

/// All parts; one if the file has none. Throws UsageError also if they do not vary the same keys.
std::vector<Part> read_parts(const toml::table& experiment, const std::string& file,
                             const Expand& expand);

/// All keys of some axes, in their order.
std::vector<std::string> keys_of(const std::vector<Axis>& axes);

/// All combinations; the last axis varies fastest. One without settings if there are no axes.
std::vector<GridPoint> cross(const std::vector<Axis>& axes);

/// The keys and values of a table, tables within it as dotted keys, in the file's order, with the
/// place of each.
struct PlacedNode {
  std::string key;
  const toml::node* node;
  std::string place;
};
std::vector<PlacedNode> flatten(const toml::table& table, const std::string& file);
/// The same of the table's own entries: a table within it is one.
std::vector<PlacedNode> entries(const toml::table& table, const std::string& file);

/// The settings of a table, each expanded: what the table has beside beats what one stands for.
std::vector<PlacedSetting> settings_in(const toml::table& table, const std::string& file,
                                       const Expand& expand);

/// A value as TOML has it, on one line; numbers as the shortest text that reads as the same.
std::string value_text(const toml::node& node);

}  // namespace tether
