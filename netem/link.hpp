#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/random.hpp"
#include "common/scenario.hpp"
#include "common/time.hpp"
#include "netem/delay_histogram.hpp"
#include "netem/state_process.hpp"

namespace tether {

/// Raw bytes on their way, never decoded.
struct Packet {
  std::string channel;  ///< under which they leave the link
  std::vector<std::uint8_t> bytes;
};

/// One direction of the network: a packet is lost with probability 1 − PRR of the channel's state
/// on arrival, or leaves after that state's delay. Packets may overtake each other when the delay
/// falls. Pure: time and randomness are arguments; one random draw per packet, whatever the PRR,
/// so that the n-th packet's luck is the same for every controller and every PRR.
class Link {
 public:
  struct Config {
    std::array<ChannelStateConfig, 2> states;  ///< indexed by StateProcess::state()
    std::int64_t queue_limit = 100'000;
  };
  /// offered = lost + overflowed + delivered + in_flight, at any time.
  struct Counters {
    std::int64_t offered = 0;
    std::int64_t lost = 0;
    std::int64_t overflowed = 0;
    std::int64_t delivered = 0;
    std::int64_t delivered_bytes = 0;
  };

  /// `state` may be shared between links.
  Link(const Config& config, std::shared_ptr<StateProcess> state, RandomEngine loss);

  /// Returns when the packet leaves; Instant::max() if it never does.
  Instant push(Instant now, Packet packet);

  /// When the next packet leaves; Instant::max() if none is under way.
  Instant next_event() const;

  /// Hands over every packet due by `now`, in order of departure, then of arrival.
  void pop_ready(Instant now, const std::function<void(const Packet&)>& deliver);

  const Counters& counters() const { return counters_; }
  std::int64_t in_flight() const { return static_cast<std::int64_t>(queue_.size()); }
  /// Sojourn times of the delivered packets.
  const DelayHistogram& delays() const { return delays_; }
  StateProcess& state() { return *state_; }
  const ChannelStateConfig& parameters() const;

 private:
  struct Entry {
    Instant departure;
    std::int64_t number;
    Instant arrival;
    Packet packet;
  };
  struct Later;

  Config config_;
  std::shared_ptr<StateProcess> state_;
  RandomEngine loss_;
  std::vector<Entry> queue_;  // a heap, earliest departure first
  Counters counters_;
  DelayHistogram delays_;
};

/// Builds the two links of a scenario, each with its own random streams, or with the uplink's state
/// for both where channel.shared_state says so.
struct LinkPair {
  Link uplink;
  Link downlink;
};
LinkPair make_links(const Scenario& scenario);

}  // namespace tether
