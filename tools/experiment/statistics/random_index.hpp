#pragma once

#include <cstddef>

#include "common/base/random.hpp"

namespace tether {

/// Uniform on [0, n), n < 2^32, by one multiplication (Lemire, ACM TOMACS 29(1), 2019). Not
/// rejecting anything, it prefers some by less than n/2^32: nothing to a bootstrap, which needs
/// millions.
inline std::size_t random_index(RandomEngine& random, std::size_t n) {
  return ((random() >> 32) * n) >> 32;
}

}  // namespace tether
