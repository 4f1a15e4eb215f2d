#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/link/link_config.hpp"

namespace tether {

// The stages of a link, each with a random stream of its own. Those that draw do so a fixed number
// of times for each packet that is offered to the link, whatever has become of it: the n-th packet
// has the same luck in a stage whichever other stages are on.

/// Independent decisions: one draw each; none if the probability is 0.
class Coin {
 public:
  Coin(double probability, RandomEngine random) : probability_(probability), random_(random) {}

  bool toss();

  /// Another probability from the next packet on.
  void set(double probability) { probability_ = probability; }
  /// Passes over the draws of so many packets.
  void skip(std::int64_t packets) { random_.discard(static_cast<std::uint64_t>(packets)); }

 private:
  double probability_;
  RandomEngine random_;
};

/// Bit errors: damages a packet with a probability by flipping `bits` different bits of it (all of
/// them if it has fewer). Two draws per packet.
class Corruption {
 public:
  Corruption(const CorruptConfig& config, RandomEngine random);

  /// What becomes of the next packet.
  struct Damage {
    bool any = false;
    std::uint64_t where = 0;  ///< decides which bits
  };
  Damage next();

  /// Flips the bits. False if there was nothing to flip.
  bool apply(const Damage& damage, std::vector<std::uint8_t>& bytes) const;

  void set(const CorruptConfig& config);
  void skip(std::int64_t packets);

 private:
  std::int64_t bits_;
  Coin coin_;
  RandomEngine where_;
};

/// Lets packets skip their delay, as tc-netem(8)'s "reorder P gap N": with the probability, but
/// only if N − 1 packets or more have been offered since the last that skipped. One draw per
/// packet.
class Reordering {
 public:
  Reordering(const ReorderConfig& config, RandomEngine random);

  bool skips_delay();

  void set(const ReorderConfig& config);
  void skip(std::int64_t packets) { coin_.skip(packets); }

 private:
  std::int64_t gap_;
  std::int64_t since_last_;
  Coin coin_;
};

/// A bottleneck of constant bit rate with a first-in-first-out queue in front of it. A packet of n
/// bytes takes 8 (n + overhead)/rate seconds, rounded to 1 ns, once those before it are through. It
/// is dropped if it would be one packet or byte too many among those not yet through (tail drop).
class RateLimit {
 public:
  explicit RateLimit(const RateConfig& config) : config_(config) {}

  /// When a packet that arrives at `now` is through; nullopt if it is dropped. `now` never goes
  /// back.
  std::optional<Instant> pass(Instant now, std::size_t bytes);

  /// Another rate and queue for packets from now on; those that wait stay as they are.
  void set(const RateConfig& config) { config_ = config; }

 private:
  struct Waiting {
    Instant through;
    std::int64_t bytes;
  };
  RateConfig config_;
  std::deque<Waiting> waiting_;  // at most queue_packets
  std::int64_t waiting_bytes_ = 0;
  Instant free_from_ = Instant::min();
};

/// Times at which packets are released, as where stations take turns to send: slot k begins at
/// k·period + U_k·jitter, with independent U_k uniform in [0, 1). The slots are a function of the
/// seed and of time. With a limit, packets beyond it wait for the next slot with room, in the order
/// in which they were offered.
class SlotSchedule {
 public:
  /// One draw from `random`, now.
  SlotSchedule(const SlotConfig& config, RandomEngine random);

  /// Takes a place in the first slot with room that begins at or after `ready`; returns when it
  /// begins. Slots that began before `now` are forgotten.
  Instant place(Instant now, Instant ready);

 private:
  Instant begin_of(std::int64_t slot) const;
  std::int64_t first_from(Instant ready) const;

  Duration period_;
  double jitter_ns_;
  std::int64_t limit_;
  std::uint64_t seed_;
  std::map<std::int64_t, std::int64_t> used_;  // slots with some packets: how many
  std::map<std::int64_t, std::int64_t> full_;  // runs of full slots: first, last
};

/// Partitions of the network from t1 to t2, t1 included, t2 not.
class OutageSchedule {
 public:
  /// `outages_s`: ascending pairs, as LinkConfig::outages.
  explicit OutageSchedule(const std::vector<std::vector<double>>& outages_s);

  bool out(Instant now) const;

 private:
  struct Outage {
    Instant from;
    Instant until;
  };
  std::vector<Outage> outages_;
};

}  // namespace tether
