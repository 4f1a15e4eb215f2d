#pragma once

#include <cstdint>

#include "common/random.hpp"
#include "common/time.hpp"

namespace tether {

/// Which state a channel is in. A function of the seed and of time only: not of the traffic, nor
/// of how often anybody asks.
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

}  // namespace tether
