#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/scenario/own_settings.hpp"

namespace tether {

/// One state of a channel.
struct ChannelStateConfig {
  double prr = 1.0;       ///< packet reception ratio, 0..1
  double delay_ms = 0.0;  ///< constant delay of the packets received in this state

  bool operator==(const ChannelStateConfig&) const = default;
};

/// netem/link/delay_law.hpp: what is added to the state's delay. The sum is never negative.
struct JitterConfig {
  enum class Law { none, constant, uniform, normal, pareto, paretonormal, gamma, table };

  Law law = Law::none;
  double mean_ms = 0.0;
  double sd_ms = 0.0;            ///< standard deviation
  double shape = 3.0;            ///< pareto, paretonormal: tail index; as in tc's table
  std::vector<double> table_ms;  ///< table: quantiles at equally spaced probabilities 0 … 1
  std::string file;              ///< table: instead, a file of observed delays in ms, one a line
  double correlation = 0.0;      ///< of the normal scores of successive packets

  bool operator==(const JitterConfig&) const = default;
};

struct ReorderConfig {
  double probability = 0.0;  ///< that a packet skips its delay and so overtakes
  std::int64_t gap = 1;      ///< at most one packet in so many

  bool operator==(const ReorderConfig&) const = default;
};

struct CorruptConfig {
  double probability = 0.0;  ///< that a packet is damaged
  std::int64_t bits = 1;     ///< bits flipped in a damaged packet, all different

  bool operator==(const CorruptConfig&) const = default;
};

struct RateConfig {
  double bits_per_s = 0.0;            ///< 0: no limit
  std::int64_t queue_packets = 1000;  ///< waiting or being sent; more are dropped
  std::int64_t queue_bytes = 0;       ///< the same in bytes, overhead included; 0: no limit
  std::int64_t overhead_bytes = 0;    ///< added to each packet's length; may be negative

  bool operator==(const RateConfig&) const = default;
};

struct SlotConfig {
  double period_ms = 0.0;    ///< between slots in which packets are released; 0: no slots
  double jitter_ms = 0.0;    ///< each slot begins later by up to this, uniformly; <= period_ms
  std::int64_t packets = 0;  ///< released per slot at most; 0: no limit

  bool operator==(const SlotConfig&) const = default;
};

/// One direction of the network: what decides its conditions (the model,
/// netem/models/kinds.hpp), then the stages that a
/// packet passes, in the order given in netem/link/link.hpp.
struct LinkConfig {
  std::string model = "fixed";  ///< the name of one of channel_model_kinds()
  /// The one state of the model fixed; of others with one delay in all states: that delay.
  ChannelStateConfig fixed;
  OwnSettings own;  ///< of the models: own.get<MarkovConfig>()

  std::int64_t queue_limit = 100'000;          ///< packets under way; more are dropped
  std::int64_t queue_limit_bytes = 1LL << 28;  ///< the same in bytes of payload
  /// No packet enters between t1 and t2 (t1 <= t < t2), seconds since the run's start; ascending.
  std::vector<std::vector<double>> outages;
  double loss = 0.0;  ///< of packets that the channel let through, independent of each other
  CorruptConfig corrupt;
  double duplicate_probability = 0.0;
  RateConfig rate;
  JitterConfig jitter;
  ReorderConfig reorder;
  bool in_order = false;  ///< no packet overtakes another one
  SlotConfig slot;

  bool operator==(const LinkConfig&) const = default;
};

}  // namespace tether
