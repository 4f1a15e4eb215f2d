#include "netem/models/gilbert_elliott.hpp"

#include <algorithm>

namespace tether {

GilbertElliott gilbert_from_burst(double prr, double mean_burst) {
  return {.p = (1.0 - prr) / (prr * mean_burst), .r = 1.0 / mean_burst};
}

double shortest_mean_burst(double prr) { return std::max(1.0, (1.0 - prr) / prr); }

GilbertElliottProcess::GilbertElliottProcess(const GilbertElliott& model, Duration delay,
                                             RandomEngine random)
    : model_(model), delay_(delay), random_(random) {}

GilbertElliottProcess::GilbertElliottProcess(const GilbertElliott& model, Duration delay,
                                             const GilbertElliottProcess& before)
    : model_(model), delay_(delay), random_(before.random_), bad_(before.bad_) {}

LinkCondition GilbertElliottProcess::on_packet(Instant) {
  const LinkCondition met = condition();
  const double luck = uniform_01(random_);
  if (luck < (bad_ ? model_.r : model_.p)) bad_ = !bad_;
  return met;
}

LinkCondition GilbertElliottProcess::condition() const {
  return {1.0 - (bad_ ? model_.one_minus_h : model_.one_minus_k), delay_};
}

}  // namespace tether
