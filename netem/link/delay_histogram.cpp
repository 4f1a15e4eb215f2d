#include "netem/link/delay_histogram.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace tether {
namespace {

// Values below 2^kBits have a bin each; above, every power of two is cut into 2^(kBits-1) bins.
constexpr int kBits = 7;
constexpr std::size_t kHalf = 1U << (kBits - 1);

std::size_t bin_of(std::uint64_t ns) {
  const int shift = std::max(0, static_cast<int>(std::bit_width(ns)) - kBits);
  return static_cast<std::size_t>(shift) * kHalf + static_cast<std::size_t>(ns >> shift);
}

}  // namespace

DelayHistogram::DelayHistogram() : bins_(bin_of(INT64_MAX) + 1) {}

void DelayHistogram::add(Duration delay) {
  delay = std::max(delay, Duration{0});
  Bin& bin = bins_[bin_of(static_cast<std::uint64_t>(delay.count()))];
  ++bin.count;
  bin.sum_ns += delay.count();
  ++count_;
  sum_ns_ += static_cast<double>(delay.count());
  max_ = std::max(max_, delay);
}

Duration DelayHistogram::quantile(double q) const {
  const auto rank = std::max<std::int64_t>(
      1, static_cast<std::int64_t>(std::ceil(q * static_cast<double>(count_))));
  std::int64_t below = 0;
  for (const Bin& bin : bins_) {
    below += bin.count;
    if (bin.count > 0 && below >= rank) return Duration{bin.sum_ns / bin.count};
  }
  return Duration{0};
}

Duration DelayHistogram::mean() const {
  return count_ == 0 ? Duration{0} : Duration{std::llround(sum_ns_ / static_cast<double>(count_))};
}

}  // namespace tether
