#pragma once

#include <algorithm>
#include <chrono>
#include <cstdlib>

namespace tether::bench {

/// Whether this is only to see that a benchmark works (TETHER_BENCH_SMOKE is set): its figures are
/// then of a few rounds and say little.
inline bool is_smoke() { return std::getenv("TETHER_BENCH_SMOKE") != nullptr; }

/// The full number of rounds, or a few.
inline int rounds(int full) { return is_smoke() ? std::min(full, 3) : full; }

/// The full time, or a moment.
inline std::chrono::seconds window(std::chrono::seconds full) {
  return is_smoke() ? std::min(full, std::chrono::seconds{1}) : full;
}

}  // namespace tether::bench
