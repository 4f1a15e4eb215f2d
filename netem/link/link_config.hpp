#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "netem/link/map_config.hpp"
#include "netem/link/trace_config.hpp"

namespace tether {

/// One state of a channel.
struct ChannelStateConfig {
  double prr = 1.0;       ///< packet reception ratio, 0..1
  double delay_ms = 0.0;  ///< constant delay of the packets received in this state

  bool operator==(const ChannelStateConfig&) const = default;
};

/// netem/models/gilbert_elliott.hpp. A link with this model gives p and r, or prr and mean_burst.
struct GilbertElliottConfig {
  std::optional<double> p;           ///< good → bad, per packet
  std::optional<double> r;           ///< bad → good, per packet
  double one_minus_h = 1.0;          ///< loss probability in the bad state
  double one_minus_k = 0.0;          ///< loss probability in the good state
  std::optional<double> prr;         ///< instead: reception ratio and …
  std::optional<double> mean_burst;  ///< … mean length of loss bursts, packets

  bool operator==(const GilbertElliottConfig&) const = default;
};

/// netem/models/four_state.hpp: probabilities per packet, names as in tc-netem(8).
struct FourStateConfig {
  std::optional<double> p13;  ///< must be given
  std::optional<double> p31;  ///< 1 − p13 if not given
  double p32 = 0.0;
  double p23 = 1.0;
  double p14 = 0.0;

  bool operator==(const FourStateConfig&) const = default;
};

/// netem/models/markov_chain.hpp: as many states as `prr` has entries.
struct ChainConfig {
  std::vector<double> prr;
  std::vector<double> delay_ms;  ///< empty: no delay in any state
  /// One of the two matrices: rates from row to column in 1/s (the diagonal is not used and must be
  /// 0 or minus the sum of the others) …
  std::vector<std::vector<double>> rates_per_s;
  /// … or probabilities of a step; each row sums to 1.
  std::vector<std::vector<double>> probabilities;
  double step_s = 0.0;  ///< probabilities: time between steps; 0 = a step per packet

  bool operator==(const ChainConfig&) const = default;
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

/// One direction of the network: what decides its conditions (the model), then the stages that a
/// packet passes, in the order given in netem/link/link.hpp.
struct LinkConfig {
  enum class Model { fixed, markov, gilbert_elliott, four_state, chain, trace, map };

  Model model = Model::fixed;
  /// model = fixed: the one state; gilbert_elliott, four_state: the delay in all states.
  ChannelStateConfig fixed;
  ChannelStateConfig good{1.0, 0.0};   ///< model = markov
  ChannelStateConfig bad{0.5, 500.0};  ///< model = markov
  double mean_good_s = 24.0;           ///< mean sojourn time in the good state
  double mean_bad_s = 8.0;             ///< mean sojourn time in the bad state
  std::optional<double> p_bad;         ///< instead: stationary P[bad] and …
  std::optional<double> mean_cycle_s;  ///< … mean time from one bad spell to the next
  GilbertElliottConfig gilbert_elliott;
  FourStateConfig four_state;
  ChainConfig chain;
  TraceConfig trace;
  MapConfig map;

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

  /// As scenario files have it.
  std::string model_name() const;

  bool operator==(const LinkConfig&) const = default;
};

}  // namespace tether
