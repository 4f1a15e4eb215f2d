#include "netem/fit/starts.hpp"

#include <algorithm>
#include <utility>

namespace tether {
namespace {

struct Clusters {
  double count = 0.0, packets = 0.0, losses = 0.0;  // sums over the bad state
  double good_packets = 0.0, good_losses = 0.0;
};

/// Bad periods: from a loss to the last one that follows within `reach` packets each.
Clusters cluster(const RunLog& log, std::int64_t reach, bool lone_losses_are_good) {
  Clusters c;
  double packets = 0.0, losses = 0.0;
  const auto finish = [&] {
    if (losses == 0.0) return;
    if (losses == 1.0 && lone_losses_are_good) {
      c.good_packets += 1.0;
      c.good_losses += 1.0;
    } else {
      c.count += 1.0;
      c.packets += packets;
      c.losses += losses;
    }
    packets = losses = 0.0;
  };
  for (const auto& segment : log.segments()) {
    for (std::size_t i = 0; i < segment.size(); ++i) {
      const RunLog::Run& run = segment[i];
      const std::int64_t length = log.lengths(run.lost)[run.length_index];
      if (run.lost) {
        packets += static_cast<double>(length);
        losses += static_cast<double>(length);
      } else if (losses > 0.0 && length < reach && i + 1 < segment.size()) {
        packets += static_cast<double>(length);
      } else {
        finish();
        c.good_packets += static_cast<double>(length);
      }
    }
    finish();
  }
  return c;
}

double inside(double numerator, double denominator) {
  constexpr double kMargin = 1e-4;
  return std::clamp(denominator > 0.0 ? numerator / denominator : 0.5, kMargin, 1.0 - kMargin);
}

}  // namespace

std::vector<GilbertElliott> fit_starts(const RunLog& log, bool free_bad, bool free_good) {
  std::vector<std::pair<double, GilbertElliott>> starts;
  for (std::int64_t reach = 1; reach <= 1024; reach *= 2) {
    for (const bool lone_are_good : {false, true}) {
      const Clusters c = cluster(log, reach, lone_are_good);
      if (c.count == 0.0) continue;
      const GilbertElliott m{inside(c.count, c.good_packets), inside(c.count, c.packets),
                             free_bad ? inside(c.losses, c.packets) : 1.0,
                             free_good ? inside(c.good_losses, c.good_packets) : 0.0};
      starts.emplace_back(log_likelihood(log, m), m);
    }
  }
  if (starts.empty())
    starts.emplace_back(0.0, GilbertElliott{0.1, 0.5, free_bad ? 0.9 : 1.0, free_good ? 0.1 : 0.0});
  std::stable_sort(starts.begin(), starts.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<GilbertElliott> best;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, starts.size()); ++i) {
    best.push_back(starts[i].second);
  }
  return best;
}

}  // namespace tether
