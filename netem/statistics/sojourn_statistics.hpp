#pragma once

#include <cstdint>
#include <vector>

#include "netem/statistics/estimate.hpp"

namespace tether {

/// How long a channel stays in each of its states. The time is the caller's, and so is its unit:
/// seconds, or packets for channels that change at every packet.
///
/// Mean = time in the state / departures from it, the maximum-likelihood estimate that uses the
/// sojourns at the beginning and end of the record as well, though neither is complete. The
/// interval is mean_time_interval()'s: exact for exponential sojourns, conservative for geometric
/// ones.
class SojournStatistics {
 public:
  explicit SojournStatistics(std::size_t states) : states_(states) {}

  /// The channel is in `state` from `when` on. Call at the record's beginning and at each change;
  /// calling again without a change does no harm. `when` never goes back.
  void enter(std::size_t state, double when);
  /// The record ends, or is looked at, at `when`.
  void advance(double when);

  std::int64_t departures(std::size_t state) const { return states_[state].departures; }
  double time_in(std::size_t state) const { return states_[state].time; }
  Estimate mean(std::size_t state, double confidence) const;

 private:
  struct State {
    double time = 0.0;
    std::int64_t departures = 0;
  };
  std::vector<State> states_;
  bool begun_ = false;
  std::size_t current_ = 0;
  double since_ = 0.0;
};

}  // namespace tether
