#include "netem/models/state_process.hpp"

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>

namespace tether {

StateProcess StateProcess::fixed() { return {}; }

StateProcess StateProcess::markov(double mean_good_s, double mean_bad_s, RandomEngine random) {
  StateProcess process;
  process.mean_s_[kGood] = mean_good_s;
  process.mean_s_[kBad] = mean_bad_s;
  process.random_ = random;
  const double p_bad = mean_bad_s / (mean_good_s + mean_bad_s);
  process.state_ = uniform_01(process.random_) < p_bad ? kBad : kGood;
  process.until_ = kStart + process.draw_sojourn();  // memoryless: no need to know when it began
  return process;
}

void StateProcess::advance(Instant now) {
  while (until_ <= now) {
    state_ = 1 - state_;
    until_ += draw_sojourn();
  }
}

Duration StateProcess::draw_sojourn() {
  constexpr double kLongest_s = 1e9;  // keeps the sum of a run's sojourns within nanosecond range
  boost::random::exponential_distribution<double> exponential(1.0 / mean_s_[state_]);
  return std::max(Duration{1}, from_seconds(std::min(kLongest_s, exponential(random_))));
}

}  // namespace tether
