#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "common/base/random.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// A link whose losses are those of a finite Markov chain.
struct ChainLink {
  Matrix transition{{1.0}};       ///< from row to column, rows sum to 1
  std::vector<double> prr{1.0};   ///< in each state, 0..1
  bool steps_by_packets = false;  ///< once for each packet that it is offered; else once a period

  /// Independent losses.
  static ChainLink independent(double prr) { return {{{1.0}}, {prr}}; }
  /// Link with bursts: losses in the second state only (Gilbert, Bell System Tech. J. 39, 1960).
  /// `prr` in (0, 1), `mean_burst` in packets, at least max(1, (1 − prr)/prr).
  static ChainLink bursts(double prr, double mean_burst);
};

/// A pose and the command that answers it, once a period: the chain moves, and the command arrives
/// or does not.
struct LossChain {
  enum Mode : std::size_t { kReceived, kLost };
  struct Jump {
    std::size_t from, to;
    double probability;  ///< probability of this jump, given `from`: those of a state sum to 1
    std::size_t mode;
  };
  std::size_t states = 1;
  std::vector<Jump> jumps;         ///< none with probability 0
  std::vector<double> stationary;  ///< stationary probabilities of the states

  /// Share of the periods in which a command arrives.
  double prr() const;
  /// After how many periods all but this share of silences are over; nullopt if it is more than
  /// 100 000, or nothing ever arrives.
  std::optional<int> silence_periods(double share) const;
};

/// Chain of a command that is sent for each pose that arrives. A downlink that steps by packets
/// steps only then: it is offered nothing when the pose is lost. States are pairs. Throws
/// UsageError if the chain has no unique stationary distribution.
LossChain both_links(const ChainLink& uplink, const ChainLink& downlink);

/// The same where both links are in one state, which moves once a period.
LossChain shared_links(const ChainLink& uplink, const std::vector<double>& downlink_prr);

/// A sequence of losses drawn from a chain, one number each. The chain outlives it.
class LossWalk {
 public:
  LossWalk(const LossChain& chain, const RandomEngine& random)
      : random_(random), from_(chain.states) {
    for (const auto& jump : chain.jumps) from_[jump.from].push_back(&jump);
    double luck = uniform_01(random_);
    while (state_ + 1 < chain.states && (luck -= chain.stationary[state_]) >= 0.0) ++state_;
  }

  /// LossChain::Mode of the next period.
  std::size_t step() {
    const auto& jumps = from_[state_];
    double luck = uniform_01(random_);
    std::size_t i = 0;
    while (i + 1 < jumps.size() && (luck -= jumps[i]->probability) >= 0.0) ++i;
    state_ = jumps[i]->to;
    return jumps[i]->mode;
  }

 private:
  RandomEngine random_;
  std::vector<std::vector<const LossChain::Jump*>> from_;
  std::size_t state_ = 0;
};

}  // namespace tether
