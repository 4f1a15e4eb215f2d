#include <fmt/format.h>

#include <cmath>

#include "tools/experiment/report/judging.hpp"

namespace tether {
namespace {

/// From no delay to half a second, by the same seeds.
void judge_rise_with_delay(const SweepData& delay, std::vector<Claim>& claims) {
  const auto none = delay.find({{kDelayKey, 0.0}}), longest = delay.find({{kDelayKey, 500.0}});
  if (!none || !longest) return;
  const Summary rise = paired_difference(delay.arms()[*longest].runs, delay.arms()[*none].runs,
                                         kConfidence, kBootstrapSeed)
                           .difference;
  const auto verdict = judge_mean(rise, kRiseWithDelay.low_m(), kRiseWithDelay.high_m());
  claims.push_back({"F3", fmt::format("ε rises by {} over 500 ms", band_text(kRiseWithDelay)),
                    fmt::format("by {} (paired)", mean_and_n(rise)), verdict, reason_of(verdict)});
}

}  // namespace

void judge_delay(const SweepData& delay, std::vector<Claim>& claims) {
  claims.push_back(
      about_means(delay, "F3", fmt::format("ε ≈ 2.1 m at 500 ms ({})", band_text(kAtLongestDelay)),
                  kDelayKey, {500.0}, kAtLongestDelay.low_m(), kAtLongestDelay.high_m()));
  judge_rise_with_delay(delay, claims);
  const auto values = delay.values(kDelayKey);
  Claim claim{"F3", "ε rises with δ, almost linearly", "", Claim::Verdict::reproduced, ""};
  double sum_x = 0, sum_y = 0, sum_xx = 0, sum_xy = 0, sum_yy = 0, n = 0;
  std::optional<std::size_t> before;
  for (const double value : values) {
    const std::size_t arm = delay.find({{kDelayKey, value}}).value();
    const double y = delay.arms()[arm].summary.mean;
    if (!std::isfinite(y)) continue;  // all its runs failed
    sum_x += value, sum_y += y, sum_xx += value * value, sum_xy += value * y, sum_yy += y * y, ++n;
    if (before) {
      const auto step = paired_difference(delay.arms()[arm].runs, delay.arms()[*before].runs,
                                          kConfidence, kBootstrapSeed);
      // A fall that chance does not explain.
      if (step.difference.mean < 0.0 && (step.separated || step.difference.sd == 0.0)) {
        claim.verdict = Claim::Verdict::not_reproduced;
        claim.reason = fmt::format("it falls before {:g} ms", value);
      }
    }
    before = arm;
  }
  if (n < 3) return;
  const double covariance = sum_xy - sum_x * sum_y / n;
  const double r2 =
      covariance * covariance / ((sum_xx - sum_x * sum_x / n) * (sum_yy - sum_y * sum_y / n));
  claim.ours = fmt::format(
      "{} at {:g} ms to {} at {:g} ms; a straight line explains {:.1f} % of the variance",
      mean_and_n(delay.arms()[delay.find({{kDelayKey, values.front()}}).value()].summary),
      values.front(), mean_and_n(delay.arms()[*before].summary), values.back(), 100.0 * r2);
  constexpr double kStraight = 0.98;  // a parabola reaches 0.93
  if (claim.reason.empty() && !(r2 >= kStraight)) {
    claim.verdict = Claim::Verdict::not_reproduced;
    claim.reason = "it rises, but not in a straight line";
  }
  claims.push_back(claim);
}

void judge_loss_against_delay(const SweepData& prr, const SweepData& delay,
                              std::vector<Claim>& claims) {
  const auto lossy = prr.find({{kPrrKey, 0.45}}), late = delay.find({{kDelayKey, 500.0}});
  if (!lossy || !late) return;
  const Summary& loss = prr.arms()[*lossy].summary;
  const Summary& lag = delay.arms()[*late].summary;
  const bool is_worse = loss.mean_interval.low > 2.0 * lag.mean;
  claims.push_back({"F2, F3", "loss hurts far more than delay",
                    fmt::format("PRR 0.45: {}; 500 ms: {}", mean_and_n(loss), mean_and_n(lag)),
                    is_worse ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced,
                    is_worse ? "" : "less than twice as much, or not beyond chance"});
}

}  // namespace tether
