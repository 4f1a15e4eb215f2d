#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <utility>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "netem/link/channel_process.hpp"

namespace tether {

/// Which of two states a channel is in. A function of the seed and of time only: not of the
/// traffic, nor of how often anybody asks.
///
/// `markov`: the two-state Markov process in continuous time. Sojourn times are exponential with
/// means T_G and T_B, so the stationary probability of the bad state is T_B/(T_G + T_B), from which
/// the state at t = 0 is drawn.
class StateProcess {
 public:
  static constexpr int kGood = 0;
  static constexpr int kBad = 1;

  /// Stays in kGood forever.
  static StateProcess fixed();
  static StateProcess markov(double mean_good_s, double mean_bad_s, RandomEngine random);

  /// Moves on to `now`; time never goes back (an earlier `now` changes nothing).
  void advance(Instant now);

  int state() const { return state_; }
  /// When the state changes next; Instant::max() if never.
  Instant next_transition() const { return until_; }

 private:
  StateProcess() = default;
  Duration draw_sojourn();

  int state_ = kGood;
  Instant until_ = Instant::max();
  double mean_s_[2] = {0.0, 0.0};
  RandomEngine random_;
};

/// One condition forever.
class FixedProcess final : public ChannelProcess {
 public:
  explicit FixedProcess(LinkCondition condition) : condition_(condition) {}

  void advance(Instant) override {}
  LinkCondition condition() const override { return condition_; }

 private:
  LinkCondition condition_;
};

/// Conditions by the state of a StateProcess, which links may share.
class MarkovProcess final : public ChannelProcess {
 public:
  /// `conditions`: in the good and in the bad state.
  MarkovProcess(std::shared_ptr<StateProcess> clock, std::array<LinkCondition, 2> conditions)
      : clock_(std::move(clock)), conditions_(conditions) {}

  void advance(Instant now) override { clock_->advance(now); }
  LinkCondition condition() const override {
    return conditions_[static_cast<std::size_t>(clock_->state())];
  }
  int state() const override { return clock_->state(); }
  Instant next_transition() const override { return clock_->next_transition(); }
  const std::shared_ptr<StateProcess>& clock() const { return clock_; }

 private:
  std::shared_ptr<StateProcess> clock_;
  std::array<LinkCondition, 2> conditions_;
};

}  // namespace tether
