#pragma once

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace tether::bench {

/// Times of single events, in ns.
class Samples {
 public:
  void add(std::int64_t ns) { ns_.push_back(ns); }
  std::size_t size() const { return ns_.size(); }
  /// Nearest rank, ms.
  double percentile_ms(double share) {
    std::sort(ns_.begin(), ns_.end());
    const auto rank = static_cast<std::size_t>(std::ceil(share * static_cast<double>(ns_.size())));
    return static_cast<double>(ns_.at(std::max<std::size_t>(rank, 1) - 1)) * 1e-6;
  }
  void report(benchmark::State& state) {
    if (ns_.empty()) throw std::runtime_error("nothing was measured");
    state.SetIterationTime(percentile_ms(0.50) * 1e-3);
    state.counters["p50_ms"] = percentile_ms(0.50);
    state.counters["p99_ms"] = percentile_ms(0.99);
    state.counters["max_ms"] = percentile_ms(1.0);
    state.counters["samples"] = static_cast<double>(ns_.size());
  }

 private:
  std::vector<std::int64_t> ns_;
};

}  // namespace tether::bench
