#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "margin/theory/mean_square.hpp"

namespace tether {

struct LyapunovTrial {
  std::size_t periods = 100'000;
  std::uint64_t seed = 1;
};

/// Growth of |z| per period along almost every sequence of losses: exp of the top Lyapunov exponent
/// lim ln|z_k|/k (Furstenberg, Kesten, 1960; Oseledets, 1968), along one drawn sequence. Below 1,
/// errors vanish with probability 1. This is weaker than mean-square stability (Jensen): in
/// between, errors vanish, but seldom get so large that their mean square grows. Sequences of one
/// seed take the same draws, so that the growth is comparable between chains of as many states. 0
/// where z vanishes.
double almost_sure_growth(const LossChain& chain, const std::vector<LoopStep>& steps,
                          const LyapunovTrial& trial = {});

}  // namespace tether
