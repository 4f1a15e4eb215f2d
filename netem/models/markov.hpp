#pragma once

#include <optional>

#include "netem/link/link_config.hpp"
#include "netem/statistics/channel_expectation.hpp"

namespace tether {

/// A good and a bad state that follow each other in time: netem/models/state_process.hpp.
struct MarkovConfig {
  ChannelStateConfig good{1.0, 0.0};
  ChannelStateConfig bad{0.5, 500.0};
  double mean_good_s = 24.0;           ///< mean sojourn time in the good state
  double mean_bad_s = 8.0;             ///< mean sojourn time in the bad state
  std::optional<double> p_bad;         ///< instead: stationary P[bad] and …
  std::optional<double> mean_cycle_s;  ///< … mean time from one bad spell to the next

  bool operator==(const MarkovConfig&) const = default;
};

/// A chain that steps once a packet.
struct TwoStateStep {
  double p;  ///< good → bad
  double r;  ///< bad → good
};

/// The two-state Markov process in continuous time as packets every `interval_s` see it:
/// π_B = T_B/(T_G + T_B), a = 1 − exp(−Δ(1/T_G + 1/T_B)), p = π_B·a, r = (1 − π_B)·a.
TwoStateStep markov_step(double mean_good_s, double mean_bad_s, double interval_s);

/// Expected statistics of packets every `interval_s`.
ChannelExpectation expect_markov(double mean_good_s, double mean_bad_s, double interval_s,
                                 ExpectedState good, ExpectedState bad);

}  // namespace tether
