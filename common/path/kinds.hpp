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
  std::vector<std::string> keys;  ///< of [path], without "path.": all others are refused
  /// Its curve, to which a speed profile is made. Throws UsageError. Null for a kind with …
  std::unique_ptr<const PathCurve> (*curve)(const PathSettings&) = nullptr;
  /// … a timing of its own.
  std::shared_ptr<const ReferencePath> (*timed)(const PathSettings&) = nullptr;
  std::vector<ScenarioKey> own_keys = {};  ///< of PathSettings::own; among `keys`, too
};

/// All kinds, in the order in which messages name them.
const std::vector<PathKind>& path_kinds();
const PathKind& kind_of(const PathSettings& settings);

/// The path that [path] describes. Throws UsageError as plan_path() does.
std::shared_ptr<const ReferencePath> make_path(const PathSettings& settings);

/// The same if it is one with a speed profile, else null. Reads path.csv. Throws UsageError that
/// names the file and line, or the key.
std::unique_ptr<const PlannedPath> plan_path(const PathSettings& settings);

}  // namespace tether
