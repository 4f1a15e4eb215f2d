#include "netem/statistics/sojourn_statistics.hpp"

#include <cassert>

namespace tether {

void SojournStatistics::advance(double when) {
  if (!begun_) return;
  assert(when >= since_);
  states_[current_].time += when - since_;
  since_ = when;
}

void SojournStatistics::enter(std::size_t state, double when) {
  assert(state < states_.size());
  advance(when);
  if (begun_ && state != current_) ++states_[current_].departures;
  begun_ = true;
  current_ = state;
  since_ = when;
}

Estimate SojournStatistics::mean(std::size_t state, double confidence) const {
  const State& s = states_[state];
  return mean_time_interval(static_cast<double>(s.departures), s.time, confidence);
}

}  // namespace tether
