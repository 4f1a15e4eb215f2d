#include "controller/laws/network_estimate.hpp"

#include <algorithm>
#include <vector>

namespace tether {

void ReceptionEstimate::add(std::int64_t seq) {
  if (!arrived_.empty() && seq <= arrived_.back()) arrived_.clear();
  if (arrived_.empty()) first_ = seq;
  arrived_.push_back(seq);
  while (arrived_.front() <= seq - window_) arrived_.pop_front();
}

double ReceptionEstimate::ratio() const {
  if (arrived_.empty()) return 1.0;
  const std::int64_t newest = arrived_.back();
  const std::int64_t numbers = std::min(window_, newest - first_ + 1);
  return static_cast<double>(arrived_.size()) / static_cast<double>(numbers);
}

void DelayEstimate::add(Duration delay) {
  delays_.push_back(std::max(delay, Duration{0}));
  if (delays_.size() > count_) delays_.pop_front();
}

Duration DelayEstimate::longest() const {
  return delays_.empty() ? Duration{0} : *std::max_element(delays_.begin(), delays_.end());
}

Duration DelayEstimate::median() const {
  if (delays_.empty()) return Duration{0};
  std::vector<Duration> sorted(delays_.begin(), delays_.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() / 2];
}

}  // namespace tether
