#include "netem/statistics/channel_check.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tether {
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
