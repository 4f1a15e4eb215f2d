#include "common/path/kinds.hpp"

#include <algorithm>
#include <cassert>

namespace tether {

#define TETHER_PATH_KINDS(KIND) \
  KIND(figure_eight)            \
  KIND(circle)                  \
  KIND(line)                    \
  KIND(rounded_rectangle)       \
  KIND(csv)

#define TETHER_DECLARE(name) PathKind name##_path();
TETHER_PATH_KINDS(TETHER_DECLARE)
#undef TETHER_DECLARE

const std::vector<PathKind>& path_kinds() {
#define TETHER_ROW(name) name##_path(),
  static const std::vector<PathKind> kinds{TETHER_PATH_KINDS(TETHER_ROW)};
#undef TETHER_ROW
  return kinds;
}

const PathKind& kind_of(const PathSettings& settings) {
  const auto& kinds = path_kinds();
  const auto found = std::find_if(kinds.begin(), kinds.end(),
                                  [&](const PathKind& kind) { return kind.name == settings.kind; });
  assert(found != kinds.end());
  return *found;
}

std::unique_ptr<const PlannedPath> plan_path(const PathSettings& settings) {
  const PathKind& kind = kind_of(settings);
  if (kind.curve == nullptr) return nullptr;
  return std::make_unique<const PlannedPath>(kind.curve(settings), settings.limits);
}

std::shared_ptr<const ReferencePath> make_path(const PathSettings& settings) {
  const PathKind& kind = kind_of(settings);
  if (kind.timed != nullptr) return kind.timed(settings);
  return plan_path(settings);
}

}  // namespace tether
