#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/path/path_settings.hpp"
#include "common/path/planned_path.hpp"
#include "common/path/reference_path.hpp"

namespace tether {

/// One of the values of path.kind. A new one is a file with a function <name>_path() that
/// returns its row, and a line in kinds.cpp.
struct PathKind {
  std::string name;
  std::vector<std::string> keys;  ///< keys of [path], without "path."; all others are refused
  /// Makes the kind's curve, which then gets a speed profile. Throws UsageError. Null for a kind
  /// that has `timed`.
  std::unique_ptr<const PathCurve> (*curve)(const PathSettings&) = nullptr;
  /// Makes the path of a kind that has a timing of its own. Null for a kind that has `curve`.
  std::shared_ptr<const ReferencePath> (*timed)(const PathSettings&) = nullptr;
  std::vector<ScenarioKey> own_keys = {};  ///< keys of PathSettings::own; also among `keys`
};

/// All kinds, in the order in which messages name them.
const std::vector<PathKind>& path_kinds();
const PathKind& kind_of(const PathSettings& settings);

/// The path that [path] describes. Throws UsageError as plan_path() does.
std::shared_ptr<const ReferencePath> make_path(const PathSettings& settings);

/// The same for a kind with a speed profile; null for other kinds. Reads path.csv. Throws
/// UsageError that names the file and line, or the key.
std::unique_ptr<const PlannedPath> plan_path(const PathSettings& settings);

}  // namespace tether
