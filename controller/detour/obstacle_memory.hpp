#pragma once

#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/path/reference_path.hpp"

namespace tether {

/// Obstacles that a vehicle reported since it asked for help: what it does not see any more,
/// while it goes around, still stands there. Cells of 0.1 m. Pure.
class ObstacleMemory {
 public:
  void clear() { seen_.clear(); }
  void add(Instant now, const std::vector<Position>& points);
  /// Forgets what was not reported since: it may have gone, and there is no way otherwise.
  void forget_before(Instant when);

  std::vector<Position> points() const;

 private:
  std::map<std::pair<std::int64_t, std::int64_t>, Instant> seen_;  ///< by cell: when last
};

}  // namespace tether
