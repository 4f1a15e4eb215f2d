#pragma once

#include <boost/random/uniform_int_distribution.hpp>
#include <cstddef>
#include <utility>
#include <vector>

#include "common/base/random.hpp"

namespace tether {

/// Any order is as likely as any other (Fisher and Yates); the same with every standard library.
template <class One>
void shuffle(std::vector<One>& all, RandomEngine& random) {
  for (std::size_t i = all.size(); i > 1; --i) {
    boost::random::uniform_int_distribution<std::size_t> any(0, i - 1);
    std::swap(all[i - 1], all[any(random)]);
  }
}

}  // namespace tether
