#pragma once

#include <cstdint>
#include <functional>

#include "tests/campaign/totals.hpp"
#include "tests/campaign/world.hpp"

namespace tether::campaign {

/// Many seeds, one after the other, on some threads.
struct Campaign {
  std::uint64_t first_seed = 1;
  std::uint64_t runs = 300;
  unsigned threads = 1;
};

/// Runs and checks them all; the same totals on any number of threads. `progress` hears now and
/// then, in the calling thread, how many have begun.
Totals run_campaign(const Setup& setup, const Campaign& campaign,
                    const std::function<void(std::uint64_t)>& progress = {});

}  // namespace tether::campaign
