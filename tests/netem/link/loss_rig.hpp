#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <functional>
#include <vector>

#include "common/base/random.hpp"
#include "netem/models/gilbert_elliott.hpp"
#include "netem/statistics/estimate.hpp"
#include "netem/statistics/loss_record.hpp"

namespace tether::test {

inline constexpr Duration kInterval = std::chrono::milliseconds{50};
inline constexpr LossSpread kIndependent{};

/// A chain, stepped by this test's own code.
struct Chain {
  std::vector<std::vector<double>> transition;
  std::vector<double> loss;
  RandomEngine random;
  std::size_t state = 0;

  bool next_is_lost() {
    const bool lost = uniform_01(random) < loss[state];
    double luck = uniform_01(random);
    std::size_t next = 0;
    while (next + 1 < loss.size() && luck >= transition[state][next]) {
      luck -= transition[state][next++];
    }
    state = next;
    return lost;
  }
};

inline Chain gilbert_elliott(const GilbertElliott& m, std::uint64_t seed) {
  Chain chain{
      {{1.0 - m.p, m.p}, {m.r, 1.0 - m.r}}, {m.one_minus_k, m.one_minus_h}, RandomEngine(seed), 0};
  chain.state = uniform_01(chain.random) < m.p / (m.p + m.r) ? 1 : 0;
  return chain;
}

inline LossRecord record_of(std::function<bool()> next_is_lost, int packets) {
  LossRecord record;
  for (int i = 0; i < packets; ++i) record.add(next_is_lost(), kStart + i * kInterval);
  return record;
}

inline LossRecord record_of(const std::vector<int>& fates) {
  std::size_t i = 0;
  return record_of([&] { return fates[i++] == 1; }, static_cast<int>(fates.size()));
}

inline bool covers(const Estimate& e, double truth) { return e.low <= truth && truth <= e.high; }

/// Misses of a 95 % interval in 1000 runs: 50 expected; 5 standard deviations of a binomial are 34.
/// Clopper and Pearson's are conservative, so fewer is right, but not none.
inline void expect_misses(int misses, const char* model, const char* quantity, int most = 84) {
  EXPECT_LE(misses, most) << quantity << ", " << model;
  EXPECT_GE(misses, 10) << quantity << ", " << model;
}

}  // namespace tether::test
