#include "tests/campaign/campaign.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <future>
#include <vector>

namespace tether::campaign {
namespace {

/// Runs seeds from `next` on until they are used up.
Totals work(const Setup& setup, const Campaign& campaign, std::atomic<std::uint64_t>& next) {
  Totals totals;
  for (std::uint64_t k = next++; k < campaign.runs; k = next++) {
    const std::uint64_t seed = campaign.first_seed + k;
    totals.add(seed, run_trial(setup, with_vehicle(draw_trial(seed)), false));
  }
  return totals;
}

}  // namespace

Totals run_campaign(const Setup& setup, const Campaign& campaign,
                    const std::function<void(std::uint64_t)>& progress) {
  std::atomic<std::uint64_t> next{0};
  std::vector<std::future<Totals>> parts;
  for (unsigned t = 0; t < campaign.threads; ++t) {
    parts.push_back(std::async(std::launch::async, [&] { return work(setup, campaign, next); }));
  }
  Totals totals;
  for (std::future<Totals>& part : parts) {
    while (part.wait_for(std::chrono::seconds{5}) == std::future_status::timeout) {
      if (progress) progress(std::min(next.load(), campaign.runs));
    }
    totals.add(part.get());
  }
  return totals;
}

}  // namespace tether::campaign
