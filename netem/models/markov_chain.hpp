#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/link/channel_process.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// A chain of N states that moves by itself in time. Its state at time t is a function of the seed
/// and of t only. Begins at t = 0 in a state drawn from the stationary distribution.
///
/// - Rates: continuous time. The sojourn in state i is exponential with mean 1/q_i, q_i = Σ_j q_ij;
///   then it goes to j with probability q_ij/q_i.
/// - Probabilities: one step every `step_s` seconds, at its multiples. The sojourn in state i is
///   geometric with mean step/(1 − p_ii).
///
/// Two draws per change of state. Takes a matrix that scenario loading has checked; throws
/// UsageError, naming `key`, if there is no single stationary distribution.
class ChainClock {
 public:
  static ChainClock from_rates(const Matrix& rates_per_s, const std::string& key,
                               RandomEngine random);
  static ChainClock from_probabilities(const Matrix& probabilities, double step_s,
                                       const std::string& key, RandomEngine random);

  /// Moves on to `now`; time never goes back.
  void advance(Instant now);
  int state() const { return state_; }
  /// When the state changes next; Instant::max() if never.
  Instant next_transition() const { return until_; }

 private:
  ChainClock(const Matrix& moves, double step_s, const std::string& key, RandomEngine random);
  void draw_sojourn(Instant from);

  Matrix cumulative_;          // cumulative moves out of each state, without the diagonal
  std::vector<double> leave_;  // rate [1/s] or probability per step of leaving
  double step_s_;              // 0: continuous time
  RandomEngine random_;
  int state_ = 0;
  Instant until_ = Instant::max();
};

/// Conditions by the state of a ChainClock, which links may share.
class ChainProcess final : public ChannelProcess {
 public:
  ChainProcess(std::shared_ptr<ChainClock> clock, std::vector<LinkCondition> conditions);

  void advance(Instant now) override { clock_->advance(now); }
  LinkCondition condition() const override {
    return conditions_[static_cast<std::size_t>(clock_->state())];
  }
  int state() const override { return clock_->state(); }
  Instant next_transition() const override { return clock_->next_transition(); }
  const std::shared_ptr<ChainClock>& clock() const { return clock_; }

 private:
  std::shared_ptr<ChainClock> clock_;
  std::vector<LinkCondition> conditions_;
};

/// A chain that takes one step per packet: a hidden Markov model of loss and delay. Each packet
/// meets the conditions of the state *before* its step, as with Gilbert and Elliott. One draw per
/// packet. Begins in a state drawn from the stationary distribution.
class PacketChainProcess final : public ChannelProcess {
 public:
  /// Like ChainClock::from_probabilities().
  PacketChainProcess(const Matrix& probabilities, std::vector<LinkCondition> conditions,
                     const std::string& key, RandomEngine random);
  /// Goes on in the state and with the stream of `before`, which has as many states.
  PacketChainProcess(const Matrix& probabilities, std::vector<LinkCondition> conditions,
                     const std::string& key, const PacketChainProcess& before);

  std::size_t states() const { return conditions_.size(); }
  void advance(Instant) override {}
  LinkCondition on_packet(Instant now) override;
  LinkCondition condition() const override { return conditions_[static_cast<std::size_t>(state_)]; }
  int state() const override { return state_; }

 private:
  Matrix cumulative_;
  std::vector<LinkCondition> conditions_;
  RandomEngine random_;
  int state_;
};

}  // namespace tether
