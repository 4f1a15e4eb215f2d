#include "netem/statistics/loss_record.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

namespace {

/// Below this a probability is the rounding of 0.
constexpr double kRounding = 1e-9;

bool is_left_to_chance(double share) { return share > kRounding && share < 1.0 - kRounding; }

/// Correlation of successive fates, by the probability `a` of one of them and `k` that it follows
/// itself.
double correlation_of(double k, double a) {
  a = std::min(a, 1.0 - 1e-12);
  return (k - a) / (1.0 - a);
}

}  // namespace

LossSpread loss_spread(double p, double p2, double var_p, double cov, double var_p2) {
  LossSpread spread;
  if (!(p > 0.0 && p < 1.0)) return spread;
  const auto variance = [&](double by_p, double by_p2) {
    return std::max(0.0, by_p * by_p * var_p + 2.0 * by_p * by_p2 * cov + by_p2 * by_p2 * var_p2);
  };
  spread.vif = var_p / (p * (1.0 - p));
  const double c = p2 / p;
  if (is_left_to_chance(c)) {
    spread.burst_vif = variance(-p2 / (p * p), 1.0 / p) * p / (c * (1.0 - c));
  }
  // k = (p2 + b)/a with b = 0 of losses, b = 1 - 2p of receptions.
  const bool of_losses = p <= 0.5;
  const double a = std::min(p, 1.0 - p);
  const double k = (of_losses ? p2 : 1.0 - 2.0 * p + p2) / a;
  if (!is_left_to_chance(k)) return spread;
  const double by_p = (of_losses ? -k : k - 2.0) / a, by_p2 = 1.0 / a;
  const double var_k = variance(by_p, by_p2);
  spread.lag1_vif = var_k * a / (k * (1.0 - k));
  const double cov_k_a = (of_losses ? 1.0 : -1.0) * (by_p * var_p + by_p2 * cov);
  if (var_k > 0.0 && var_p > 0.0) {
    spread.lag1_with_share = std::clamp(cov_k_a / std::sqrt(var_k * var_p), -1.0, 1.0);
  }
  return spread;
}

void LossRecord::add(bool lost, Instant sent) {
  if (packets_ == 0) {
    begins_lost_ = lost;
  } else {
    const double interval_s = to_seconds(sent - last_sent_);
    const double deviation = interval_s - interval_mean_s_;
    interval_mean_s_ += deviation / static_cast<double>(packets_);
    interval_squares_ += deviation * (interval_s - interval_mean_s_);
  }
  last_sent_ = sent;
  ++packets_;
  const bool after_lost = current_burst_ > 0;
  batches_.add({lost ? 1 : 0, lost && after_lost ? 1 : 0});
  if (lost) {
    ++lost_;
    if (!after_lost) ++bursts_;
    longest_burst_ = std::max(longest_burst_, ++current_burst_);
  } else if (after_lost) {
    const std::size_t length = std::min(kLongestBurst, static_cast<std::size_t>(current_burst_));
    if (burst_histogram_.size() <= length) burst_histogram_.resize(length + 1);
    ++burst_histogram_[length];
    current_burst_ = 0;
  }
}

double LossRecord::interval_variation() const {
  if (packets_ < 3 || !(interval_mean_s_ > 0.0)) return 0.0;
  return std::sqrt(interval_squares_ / static_cast<double>(packets_ - 2)) / interval_mean_s_;
}

Estimate LossRecord::share(double share, double trials, double confidence, double vif,
                           double degrees_of_freedom) {
  double effective = trials / std::max(1e-9, vif);
  if (!std::isinf(degrees_of_freedom)) {
    // Korn & Graubard's correction for a variance that is itself estimated.
    const double ratio =
        normal_quantile(confidence) / student_quantile(confidence, degrees_of_freedom);
    effective *= ratio * ratio;
  }
  return proportion_interval(share * effective, effective, confidence);
}

Estimate LossRecord::prr(double confidence, const LossSpread& spread) const {
  if (packets_ == 0) return {};
  const auto n = static_cast<double>(packets_);
  return share(static_cast<double>(packets_ - lost_) / n, n, confidence, spread.vif,
               spread.degrees_of_freedom);
}

Estimate LossRecord::mean_burst(double confidence, const LossSpread& spread) const {
  if (bursts_ == 0) return {};
  const auto lost = static_cast<double>(lost_), bursts = static_cast<double>(bursts_);
  Estimate e =
      share((lost - bursts) / lost, lost, confidence, spread.burst_vif, spread.degrees_of_freedom);
  e.value = lost / bursts;
  e.low = 1.0 / (1.0 - e.low);
  e.high = 1.0 / (1.0 - e.high);
  return e;
}

Estimate LossRecord::lag1_correlation(double confidence, const LossSpread& spread) const {
  if (lost_ == 0 || lost_ == packets_) return {};
  // Counts the rarer fate: how often it occurs, and how often it is followed by itself.
  const bool of_losses = 2 * lost_ <= packets_;
  const std::int64_t count = of_losses ? lost_ : packets_ - lost_;
  const std::int64_t received_runs =
      bursts_ + (begins_lost_ ? 0 : 1) - (current_burst_ > 0 ? 1 : 0);
  const std::int64_t runs = of_losses ? bursts_ : received_runs;
  const auto events = static_cast<double>(count);
  const auto n = static_cast<double>(packets_);
  const Estimate k = share(static_cast<double>(count - runs) / events, events, confidence,
                           spread.lag1_vif, spread.degrees_of_freedom);
  const Estimate a = share(events / n, n, confidence, spread.vif, spread.degrees_of_freedom);
  Estimate e{correlation_of(k.value, a.value), 0.0, 0.0, k.effective_samples};
  // It grows with k and falls with a: what helps one hinders the other.
  const auto distance = [&](double k_bound, double a_bound) {
    const double by_k = std::abs(e.value - correlation_of(k_bound, a.value));
    const double by_a = std::abs(e.value - correlation_of(k.value, a_bound));
    return std::sqrt(
        std::max(0.0, by_k * by_k + by_a * by_a - 2.0 * spread.lag1_with_share * by_k * by_a));
  };
  e.low = std::max(-1.0, e.value - distance(k.low, a.high));
  e.high = std::min(1.0, e.value + distance(k.high, a.low));
  return e;
}

LossSpread LossRecord::estimated_spread() const {
  LossSpread spread;
  const auto batches = static_cast<double>(batches_.batches());
  if (batches_.batches() < BatchMeans<2>::kMostBatches / 2) {
    spread.reliable = false;
    return spread;
  }
  const double var_p = batches_.asymptotic_variance({1.0, 0.0});
  const double var_p2 = batches_.asymptotic_variance({0.0, 1.0});
  const double cov = 0.5 * (batches_.asymptotic_variance({1.0, 1.0}) - var_p - var_p2);
  const auto n = static_cast<double>(packets_);
  spread = loss_spread(static_cast<double>(lost_) / n, static_cast<double>(lost_ - bursts_) / n,
                       var_p, cov, var_p2);
  // Losses that avoid each other spread less than independent ones, but so do few batches that are
  // equal.
  spread.vif = std::max(1.0, spread.vif);
  spread.burst_vif = std::max(1.0, spread.burst_vif);
  spread.lag1_vif = std::max(1.0, spread.lag1_vif);
  spread.degrees_of_freedom = batches - 1.0;
  spread.reliable = batches_.batch_correlation({1.0, 0.0}) < 2.33 / std::sqrt(batches);
  return spread;
}

}  // namespace tether
