#pragma once

#include <cstddef>
#include <vector>

#include "common/base/random.hpp"
#include "margin/theory/loss_chain.hpp"

namespace tether {

/// A sequence of losses drawn from a chain, one number each. The chain outlives it.
class LossWalk {
 public:
  LossWalk(const LossChain& chain, const RandomEngine& random)
      : random_(random), from_(chain.states) {
    for (const auto& jump : chain.jumps) from_[jump.from].push_back(&jump);
    double luck = uniform_01(random_);
    while (state_ + 1 < chain.states && (luck -= chain.stationary[state_]) >= 0.0) ++state_;
  }

  /// LossChain::Mode of the next period.
  std::size_t step() {
    const auto& jumps = from_[state_];
    double luck = uniform_01(random_);
    std::size_t i = 0;
    while (i + 1 < jumps.size() && (luck -= jumps[i]->probability) >= 0.0) ++i;
    state_ = jumps[i]->to;
    return jumps[i]->mode;
  }

 private:
  RandomEngine random_;
  std::vector<std::vector<const LossChain::Jump*>> from_;
  std::size_t state_ = 0;
};

}  // namespace tether
