#pragma once

#include <cstddef>

#include "common/base/random.hpp"

namespace tether {

/// Uniform on [0, n), n < 2^32, by one multiplication (Lemire, ACM TOMACS 29(1), 2019). It rejects
/// nothing, so that some numbers come more often than others, by less than n/2^32: negligible for a
/// bootstrap, which needs millions of numbers.
inline std::size_t random_index(RandomEngine& random, std::size_t n) {
  return ((random() >> 32) * n) >> 32;
}

}  // namespace tether
