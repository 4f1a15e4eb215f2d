#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/models/gilbert_elliott.hpp"

namespace tether::test {

struct Network {
  double loss = 0.0;
  double mean_burst = 1.0;  ///< mean length of losses, packets; 1: one by one
  double delay_s = 0.0;
  double jitter_s = 0.0;  ///< mean of what is added to the delay, exponential
};

/// Loses, delays, repeats and so reorders; a loss may begin a burst (the channel model
/// gilbert_elliott). One packet in a hundred begins an outage of up to 4 s.
template <class Message>
class LossyChannel {
 public:
  LossyChannel(std::uint64_t seed, const std::string& name, const Network& network)
      : random_(random_stream(seed, name)), network_(network) {
    if (network.loss <= 0.0 || network.mean_burst <= 1.0) return;
    const double prr = 1.0 - network.loss;
    bursts_.emplace(gilbert_from_burst(prr, std::max(network.mean_burst, shortest_mean_burst(prr))),
                    Duration{}, random_stream(seed, name + " bursts"));
  }

  void send(Instant now, const Message& message) {
    if (now >= out_until_ && uniform_01(random_) < 0.01) {
      out_until_ = now + from_seconds(4.0 * uniform_01(random_));
    }
    const int copies = uniform_01(random_) < 0.1 ? 2 : 1;
    for (int i = 0; i < copies; ++i) {
      const double loss = bursts_ ? 1.0 - bursts_->on_packet(now).prr : network_.loss;
      if (now < out_until_ || uniform_01(random_) < loss) continue;
      const double jitter_s = -network_.jitter_s * std::log(1.0 - uniform_01(random_));
      waiting_.push_back({now + from_seconds(network_.delay_s + jitter_s), message});
    }
  }

  std::vector<Message> arrived(Instant now) {
    std::stable_sort(waiting_.begin(), waiting_.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<Message> due;
    auto next = waiting_.begin();
    for (; next != waiting_.end() && next->first <= now; ++next) due.push_back(next->second);
    waiting_.erase(waiting_.begin(), next);
    return due;
  }

 private:
  RandomEngine random_;
  Network network_;
  std::optional<GilbertElliottProcess> bursts_;
  Instant out_until_{};
  std::vector<std::pair<Instant, Message>> waiting_;
};

}  // namespace tether::test
