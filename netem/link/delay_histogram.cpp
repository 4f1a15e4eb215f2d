#include "netem/link/delay_histogram.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

void DelayHistogram::add(Duration delay) {
  delay = std::max(delay, Duration{0});
  Bin& bin = bins_.of(delay.count());
  ++bin.count;
  bin.sum_ns += delay.count();
  ++count_;
  sum_ns_ += static_cast<double>(delay.count());
  max_ = std::max(max_, delay);
}

Duration DelayHistogram::quantile(double q) const {
  if (count_ == 0) return Duration{0};
  const auto rank = static_cast<std::int64_t>(std::ceil(q * static_cast<double>(count_)));
  const Bin& bin = bins_.of_rank(std::max<std::int64_t>(1, rank));
  return Duration{bin.sum_ns / bin.count};
}

Duration DelayHistogram::mean() const {
  return count_ == 0 ? Duration{0} : Duration{std::llround(sum_ns_ / static_cast<double>(count_))};
}

}  // namespace tether
