#pragma once

#include <cstdint>

#include "common/base/time.hpp"

namespace tether {

/// How late this machine wakes the loop that steers, while other work keeps it busy.
struct Latency {
  std::int64_t wakeups = 0;
  double worst_ms = 0.0;
  double p999_ms = 0.0;  ///< 99.9 % are no later
  double seconds = 0.0;
  bool is_realtime = false;      ///< SCHED_FIFO and locked memory were granted
  bool realtime_kernel = false;  ///< PREEMPT_RT
};

/// Runs the nodes' loop for `time`, woken each millisecond, with the bridge's priority (SCHED_FIFO
/// 50) and locked memory if they are granted. A thread on each processor computes in memory
/// meanwhile, and one writes to the disk. SIGINT ends it early.
Latency measure_latency(Duration time);

}  // namespace tether
