#pragma once

#include <cstdint>

#include "common/base/random.hpp"

namespace tether {

/// Independent decisions: one draw each; none if the probability is 0.
class Coin {
 public:
  Coin(double probability, RandomEngine random) : probability_(probability), random_(random) {}

  bool toss() { return probability_ > 0.0 && uniform_01(random_) < probability_; }

  /// Another probability from the next packet on.
  void set(double probability) { probability_ = probability; }
  /// Passes over the draws of so many packets.
  void skip(std::int64_t packets) { random_.discard(static_cast<std::uint64_t>(packets)); }

 private:
  double probability_;
  RandomEngine random_;
};

}  // namespace tether
