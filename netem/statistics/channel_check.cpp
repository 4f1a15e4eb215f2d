#include "netem/statistics/channel_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/distributions/binomial.hpp>
#include <cassert>
#include <cmath>
#include <limits>

namespace tether {
void DelayStatistics::add(Duration delay) {
  const std::int64_t ns = std::max<std::int64_t>(0, delay.count());
  Bin& bin = bins_.of(ns);
  bin.low_ns = bin.count == 0 ? ns : std::min(bin.low_ns, ns);
  bin.high_ns = bin.count == 0 ? ns : std::max(bin.high_ns, ns);
  bin.sum_ns += static_cast<double>(ns);
  ++bin.count;
  shortest_ns_ = count_ == 0 ? ns : std::min(shortest_ns_, ns);
  longest_ns_ = std::max(longest_ns_, ns);
  ++count_;
  sum_ns_ += static_cast<double>(ns);
  if (count_ > kPilot) {
    indicate(ns);
    return;
  }
  pilot_.push_back(ns);
  if (count_ == kPilot) choose_thresholds();
}

void DelayStatistics::choose_thresholds() {
  std::vector<std::int64_t> sorted = pilot_;
  std::sort(sorted.begin(), sorted.end());
  for (std::size_t i = 0; i < kQuantiles.size(); ++i) {
    indicators_[i].threshold_ns =
        sorted[static_cast<std::size_t>(std::ceil(kQuantiles[i] * static_cast<double>(kPilot))) -
               1];
  }
  for (std::int64_t ns : pilot_) indicate(ns);
  pilot_ = {};
}

void DelayStatistics::indicate(std::int64_t delay_ns) {
  for (Indicator& indicator : indicators_) {
    const std::int64_t below = delay_ns <= indicator.threshold_ns ? 1 : 0;
    indicator.below += below;
    indicator.batches.add({below});
  }
}

double DelayStatistics::mean_s() const {
  return count_ == 0 ? std::numeric_limits<double>::quiet_NaN()
                     : sum_ns_ * 1e-9 / static_cast<double>(count_);
}

Estimate DelayStatistics::quantile(double q, double confidence, double vif) const {
  assert(q > 0.0 && q < 1.0 && vif > 0.0);
  if (count_ == 0) return {};
  const auto n = static_cast<double>(count_);
  const double effective = n / vif;
  const auto rank = [&](double share) {
    return std::clamp<std::int64_t>(static_cast<std::int64_t>(std::ceil(share * n)), 1, count_);
  };
  const Bin& middle = bins_.of_rank(rank(q));
  Estimate e;
  e.value = middle.sum_ns / static_cast<double>(middle.count) * 1e-9;
  e.low = 0.0;
  e.effective_samples = effective;
  if (effective < 1.0) return e;

  // The number of samples below the quantile is binomial; Boost rounds its quantiles outwards.
  const double tail = 0.5 * (1.0 - confidence);
  const boost::math::binomial below(std::floor(effective), q);
  const double low_rank = boost::math::quantile(below, tail);
  const double high_rank = boost::math::quantile(boost::math::complement(below, tail)) + 1.0;
  if (low_rank >= 1.0) {
    const double r = std::max(1.0, std::floor(low_rank * vif));
    e.low = static_cast<double>(bins_.of_rank(rank(r / n)).low_ns) * 1e-9;
  }
  if (high_rank * vif <= n) {
    e.high = static_cast<double>(bins_.of_rank(rank(high_rank * vif / n)).high_ns) * 1e-9;
  }
  return e;
}

double DelayStatistics::estimated_vif(std::size_t index) const {
  const Indicator& indicator = indicators_[index];
  const double p =
      count_ == 0 ? 0.0 : static_cast<double>(indicator.below) / static_cast<double>(count_);
  if (count_ < kPilot || !(p > 0.0 && p < 1.0)) return 1.0;
  return std::max(1.0, indicator.batches.asymptotic_variance({1.0}) / (p * (1.0 - p)));
}

bool DelayStatistics::vif_is_reliable(std::size_t index) const {
  const BatchMeans<1>& batches = indicators_[index].batches;
  return count_ >= kPilot && batches.batch_correlation({1.0}) <
                                 2.33 / std::sqrt(static_cast<double>(batches.batches()));
}

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

namespace {

// Rounding of times to nanoseconds, and of sums.
constexpr double kSlack_s = 2e-9;
constexpr double kSlack = 1e-12;
// The share of a state that is left for good, with the rounding of its computation.
constexpr double kNever = 1e-12;

Verdict judge(double configured, const Estimate& achieved, double slack, double widest) {
  if (std::isnan(achieved.value)) return Verdict::too_short;
  if (configured < achieved.low - slack || configured > achieved.high + slack) {
    return Verdict::outside;
  }
  return 0.5 * (achieved.high - achieved.low) <= widest ? Verdict::ok : Verdict::too_short;
}

class Checker {
 public:
  Checker(const ChannelExpectation& expected, const LossRecord& loss, const DelayStatistics& delays,
          const SojournStatistics* sojourns, const ChannelCheckOptions& options)
      : expected_(expected), loss_(loss), delays_(delays), sojourns_(sojourns), o_(options) {
    const std::size_t states = sojourns != nullptr ? expected.states().size() : 0;
    const auto quantities = static_cast<double>(3 + states + DelayStatistics::kQuantiles.size());
    confidence_ = 1.0 - o_.false_alarm / quantities;
  }

  std::vector<ChannelCheck> run() {
    check_losses();
    if (sojourns_ != nullptr) check_sojourns();
    check_delays();
    return std::move(checks_);
  }

 private:
  void check_losses() {
    const LossSpread& spread = expected_.spread();
    const double prr = expected_.prr(), burst = expected_.mean_burst();
    const double lag1 = expected_.lag1_correlation();
    const Estimate achieved = loss_.prr(confidence_, spread);
    const double rarer = std::min(prr, 1.0 - prr);
    // A channel that loses nothing, or everything, is right as long as none does otherwise. Of
    // others, where the record begins and ends within a pattern may shift a share by 1/packets.
    const double widest = rarer > 0.0 ? o_.precision * rarer : o_.precision;
    const double ends = 1.0 / std::max(1.0, static_cast<double>(loss_.packets()));
    const double slack = rarer > 0.0 ? kSlack + ends : kSlack;
    checks_.push_back({"PRR", "", prr, loss_.prr(o_.shown_confidence, spread),
                       judge(prr, achieved, slack, widest), ""});
    const bool irregular = expected_.sojourn_unit() == ChannelExpectation::Unit::seconds &&
                           expected_.states().size() > 1 &&
                           loss_.interval_variation() > o_.most_interval_variation;
    const auto add = [&](const char* quantity, const char* unit, double configured,
                         const Estimate& shown, const Estimate& judged, double widest_half) {
      if (!std::isfinite(configured)) return;
      Verdict verdict =
          judge(configured, judged, slack * configured_scale(configured), widest_half);
      if (achieved.effective_samples < o_.least_samples) verdict = Verdict::too_short;
      checks_.push_back({quantity, unit, configured, shown, verdict, ""});
      if (!irregular) return;
      checks_.back().configured = std::numeric_limits<double>::quiet_NaN();
      checks_.back().verdict = Verdict::not_comparable;
      checks_.back().reason = "the model moves in time, and packets come at irregular times";
    };
    add("mean loss burst", "packets", burst, loss_.mean_burst(o_.shown_confidence, spread),
        loss_.mean_burst(confidence_, spread), o_.precision * burst);
    add("lag-1 correlation", "", lag1, loss_.lag1_correlation(o_.shown_confidence, spread),
        loss_.lag1_correlation(confidence_, spread), o_.precision);
  }

  /// Scale of the slack that packets at the record's ends may cause.
  static double configured_scale(double configured) {
    return 4.0 * std::max(1.0, std::abs(configured));
  }

  void check_sojourns() {
    const bool seconds = expected_.sojourn_unit() == ChannelExpectation::Unit::seconds;
    for (std::size_t s = 0; s < expected_.states().size(); ++s) {
      const double configured = expected_.mean_sojourn(s);
      if (!std::isfinite(configured) || expected_.stationary()[s] <= kNever) continue;
      const Estimate achieved = sojourns_->mean(s, confidence_);
      Verdict verdict = judge(configured, achieved, kSlack * configured, o_.precision * configured);
      // Without a departure there is no estimate, but there is a lower bound.
      if (configured < achieved.low) verdict = Verdict::outside;
      checks_.push_back({fmt::format("mean sojourn ({})", expected_.states()[s].name),
                         seconds ? "s" : "packets", configured,
                         sojourns_->mean(s, o_.shown_confidence), verdict, ""});
    }
  }

  void check_delays() {
    // A quantile of or near 0 cannot be the measure of its own interval; the law's spread can.
    const double spread_s = expected_.delay_quantile(0.99) - expected_.delay_quantile(0.5);
    for (const double q : DelayStatistics::kQuantiles) {
      const double configured_s = expected_.delay_quantile(q);
      if (std::isnan(configured_s)) continue;
      const double vif = expected_.delay_vif(q);
      const Estimate achieved = delays_.quantile(q, confidence_, vif);
      Estimate shown = delays_.quantile(q, o_.shown_confidence, vif);
      const double scale_s = std::max(configured_s, 0.5 * spread_s);
      Verdict verdict =
          judge(configured_s, achieved, kSlack_s, std::max(kSlack_s, o_.precision * scale_s));
      if (achieved.effective_samples < o_.least_samples) verdict = Verdict::too_short;
      if (expected_.delay_is_constant() && delays_.count() > 0) {
        // Same reasoning as for the PRR: right as long as no packet's is different.
        const bool same = delays_.shortest_s() >= configured_s - kSlack_s &&
                          delays_.longest_s() <= configured_s + kSlack_s;
        verdict = same ? Verdict::ok : Verdict::outside;
      }
      for (double* x : {&shown.value, &shown.low, &shown.high}) *x *= 1e3;
      checks_.push_back(
          {fmt::format("delay p{:.0f}", 100.0 * q), "ms", 1e3 * configured_s, shown, verdict, ""});
    }
  }

  const ChannelExpectation& expected_;
  const LossRecord& loss_;
  const DelayStatistics& delays_;
  const SojournStatistics* sojourns_;
  const ChannelCheckOptions& o_;
  double confidence_ = 0.0;
  std::vector<ChannelCheck> checks_;
};

}  // namespace

std::string to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::ok:
      return "ok";
    case Verdict::outside:
      return "outside";
    case Verdict::too_short:
      return "too short";
    case Verdict::not_comparable:
      return "not comparable";
  }
  return "";
}

std::vector<ChannelCheck> compare_channel(const ChannelExpectation& expected,
                                          const LossRecord& loss, const DelayStatistics& delays,
                                          const SojournStatistics* sojourns,
                                          const ChannelCheckOptions& options) {
  return Checker(expected, loss, delays, sojourns, options).run();
}

Verdict overall(const std::vector<ChannelCheck>& checks) {
  const auto any = [&](Verdict v) {
    return std::any_of(checks.begin(), checks.end(),
                       [v](const ChannelCheck& c) { return c.verdict == v; });
  };
  if (any(Verdict::outside)) return Verdict::outside;
  if (any(Verdict::too_short)) return Verdict::too_short;
  return any(Verdict::ok) ? Verdict::ok : Verdict::not_comparable;
}

}  // namespace tether
