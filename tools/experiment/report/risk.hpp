#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/experiment/figures/figures.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// Definition of the risk at a place of the path: what a bad channel there costs. The paper does
/// not define it.
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

/// "mean ε of the runs in B there" …
std::string to_text(RiskDefinition definition);

/// A mean and its interval.
struct MeanEstimate {
  double mean = 0.0;
  Interval interval;
};

/// The risk in the first, second and last third of the path and before its first sharp turn, and
/// how far it falls: intervals by the bootstrap (percentiles) over whole runs, since a run's points
/// hang together.
struct RiskFall {
  RiskDefinition definition = RiskDefinition::whole_run;
  std::array<MeanEstimate, 3> thirds;
  MeanEstimate to_second, to_last;  ///< first − second, first − last
  MeanEstimate before_turns;        ///< NaN where the path has no sharp turn, and in the next
  MeanEstimate to_rest;             ///< before the first sharp turn − from there on
  std::size_t runs = 0;
};
RiskFall risk_fall(const RunStore& store, RiskDefinition definition);

}  // namespace tether
