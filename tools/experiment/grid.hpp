#pragma once

#include <toml++/toml.h>

#include <string>
#include <vector>

#include "tools/experiment/experiment.hpp"

namespace tether {

/// Keys that vary together, and their values.
struct Axis {
  std::vector<std::string> keys;
  std::vector<std::vector<KeyValue>> points;  ///< one value of each key
  std::string place;                          ///< "file.toml:12"
};

/// The axes of [grid], each key one, and of [[zip]], each table one, in the file's order. Throws
/// UsageError for values that are no list and no range, lists without values, with a value twice or
/// of different lengths within a zip, and keys given twice.
std::vector<Axis> read_axes(const toml::table& experiment, const std::string& file);

/// All combinations; the last axis varies fastest. One without settings if there are no axes.
std::vector<std::vector<KeyValue>> cross(const std::vector<Axis>& axes);

/// The keys and values of a table, tables within it as dotted keys, in the file's order, with the
/// place of each.
struct PlacedNode {
  std::string key;
  const toml::node* node;
  std::string place;
};
std::vector<PlacedNode> flatten(const toml::table& table, const std::string& file);

/// A value as TOML has it, on one line; numbers as the shortest text that reads as the same.
std::string value_text(const toml::node& node);

}  // namespace tether
