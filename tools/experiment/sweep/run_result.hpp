#pragma once

#include <string>
#include <vector>

#include "tools/runs/metric.hpp"

namespace tether {

/// A vehicle's state at one time.
struct TrajectoryPoint {
  float t_s, x_m, y_m, x_ref_m, y_ref_m, error_m;
  float uplink_state, downlink_state;  ///< last reported state: 0 good, 1 bad

  bool operator==(const TrajectoryPoint&) const = default;
};

/// A run of a sweep.
struct RunResult {
  std::vector<double> metrics = std::vector<double>(tether::metrics().size());  ///< in their order
  std::vector<TrajectoryPoint> trajectory;
  std::string failure;  ///< why there are no metrics; empty if there are
  /// The failure is this machine's and not the run's: its controller was killed, or memory,
  /// processes or files ran out. Another try may have another end, so that this is no result.
  bool is_to_be_repeated = false;

  bool operator==(const RunResult&) const = default;
};

}  // namespace tether
