#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/experiment/figures.hpp"
#include "tools/experiment/run_store.hpp"

namespace tether {

/// What a bad channel at some place of the path costs. The paper leaves it open.
enum class RiskDefinition : std::uint8_t {
  whole_run,  ///< ε of the whole run. The only one with the paper's shape: it is 13 m at the start,
              ///< where the error itself must be 0
  next_10_s,  ///< the mean error of the next 10 s (what is left of them at the end)
  now         ///< the error at that moment
};

/// The mean over the runs in which the channel was in its bad state (of either direction) when the
/// planned position was here; one point for each kept row of trajectory. Runs that failed are in
/// none.
std::vector<RiskPoint> risk_points(const RunStore& store, RiskDefinition definition);

/// The risk in the first, second and last third of the path, and how far it falls from the first:
/// intervals by the bootstrap (percentiles) over whole runs, since a run's points hang together.
struct RiskFall {
  std::array<double, 3> thirds{};
  std::array<Interval, 2> fall;  ///< first − second, first − last
  std::size_t runs = 0;
};
RiskFall risk_fall(const RunStore& store, RiskDefinition definition);

}  // namespace tether
