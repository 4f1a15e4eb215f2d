#pragma once

#include <cstdint>

#include "common/scenario/section.hpp"

namespace tether {

/// [run]
struct RunSettings {
  double duration_s = 62.0;
  /// The loop lives this long before the path starts at t = 0: poses flow, the vehicle stands,
  /// the controller commands zero, drives start up and are armed. 0: everything starts at once.
  double lead_s = 0.0;
  std::uint64_t seed = 1;
  double truth_rate_hz = 50.0;   ///< SIM/TRUTH messages and rows of trajectory.csv
  double report_period_s = 1.0;  ///< NET/… and …/COUNTERS
};

ScenarioSection run_section();

}  // namespace tether
