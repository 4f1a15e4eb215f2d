#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/experiment/report/judging.hpp"

namespace tether {
namespace {

/// A claim about the largest of the means, as the paper says "up to".
Claim about_plateau(const SweepData& prr) {
  const std::vector<double> prrs{0.2, 0.25, 0.3, 0.35, 0.4};
  const std::string paper = fmt::format(
      "mean ε up to 23 m on the plateau, PRR 0.2 to 0.4 (the largest: {})", band_text(kPlateau));
  Claim claim = about_means(prr, "F2", paper, kPrrKey, prrs, 0.0, kPlateau.high_m());
  if (claim.reason.starts_with("no runs")) return claim;
  const Summary* largest = nullptr;
  for (const double value : prrs) {
    const Summary& summary = prr.arms()[prr.find({{kPrrKey, value}}).value()].summary;
    if (largest == nullptr || summary.mean > largest->mean) largest = &summary;
  }
  claim.verdict = judge_mean(*largest, kPlateau.low_m(), kPlateau.high_m());
  claim.reason = reason_of(claim.verdict);
  return claim;
}

void judge_baseline(const SweepData& prr, const std::vector<CommandedRuns>& by_command,
                    std::vector<Claim>& claims) {
  claims.push_back(about_means(
      prr, "F2", fmt::format("ε ≈ 1.8 m at PRR 1, τ = 2 s ({})", band_text(kUnimpaired)), kPrrKey,
      {1.0}, kUnimpaired.low_m(), kUnimpaired.high_m()));
  claims.push_back(about_means(prr, "F2", fmt::format("below {:g} m at PRR 0.85", kNearlyDown_m),
                               kPrrKey, {0.85}, 0.0, kNearlyDown_m));
  claims.push_back(about_plateau(prr));
  claims.push_back(
      about_means(prr, "F2", fmt::format("ε ≈ 15 m at PRR ≤ 0.1 ({})", band_text(kFewCommands)),
                  kPrrKey, {0.05, 0.1}, kFewCommands.low_m(), kFewCommands.high_m(), by_command));
}

void judge_singles(const SweepData& prr, std::vector<Claim>& claims) {
  double largest = 0.0;
  std::size_t n = 0, high = 0;
  for (std::size_t arm = 0; arm < prr.arms().size(); ++arm) {
    const double x = prr.number(arm, kPrrKey);
    if (!(x >= 0.2 && x <= 0.4)) continue;
    for (const SeededValue& run : prr.arms()[arm].runs) {
      if (!std::isfinite(run.value)) continue;
      largest = std::max(largest, run.value);
      high += run.value >= kWorstRun.low_m() ? 1 : 0;
      ++n;
    }
  }
  if (n == 0) return;
  constexpr std::size_t kEnough = 100;  // fewer may have no such run among them by chance
  Claim::Verdict verdict = Claim::Verdict::not_reproduced;
  const bool is_low = largest < kWorstRun.low_m();
  if (!is_low && largest <= kWorstRun.high_m()) verdict = Claim::Verdict::reproduced;
  if (is_low && n < kEnough) verdict = Claim::Verdict::undecided;
  claims.push_back({"F2",
                    fmt::format("single runs on the plateau reach 30 m ({})", band_text(kWorstRun)),
                    fmt::format("the largest of {} runs is {:.1f} m; {} are at {:g} m or above", n,
                                largest, high, kWorstRun.low_m()),
                    verdict,
                    verdict == Claim::Verdict::reproduced
                        ? ""
                        : "extremes depend on the walls and on the number of runs"});
}

/// Falls to both sides of its peak, beyond what chance does.
void judge_bell(const SweepData& prr, std::vector<Claim>& claims) {
  std::size_t peak = 0;
  for (std::size_t arm = 0; arm < prr.arms().size(); ++arm) {
    if (prr.arms()[arm].summary.mean > prr.arms()[peak].summary.mean) peak = arm;
  }
  const auto values = prr.values(kPrrKey);
  const auto least = prr.find({{kPrrKey, values.front()}}),
             most = prr.find({{kPrrKey, values.back()}});
  if (!least || !most || values.size() < 3) return;
  const auto& top = prr.arms()[peak];
  const auto drop = [&](std::size_t arm) {
    return paired_difference(top.runs, prr.arms()[arm].runs, kConfidence, kBootstrapSeed);
  };
  const auto left = drop(*least), right = drop(*most);
  const double x = prr.number(peak, kPrrKey);
  const bool falls = left.separated && right.separated;
  const bool is_inside = x > 0.15 && x < 0.45;
  Claim::Verdict verdict =
      falls && is_inside ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced;
  if (is_inside && !falls) verdict = Claim::Verdict::undecided;
  claims.push_back(
      {"F2", "bell shape: largest between PRR 0.15 and 0.45, lower on both sides",
       fmt::format("largest at PRR {:g}: {}; higher than at {:g} by {} m, than at {:g} "
                   "by {} m (paired)",
                   x, mean_and_n(top.summary), values.front(), mean_text(left.difference),
                   values.back(), mean_text(right.difference)),
       verdict,
       verdict == Claim::Verdict::undecided        ? "more seeds are needed to tell"
       : verdict == Claim::Verdict::not_reproduced ? "the largest mean is elsewhere"
                                                   : ""});
}

}  // namespace

void judge_loss(const SweepData& prr, const std::vector<CommandedRuns>& by_command,
                std::vector<Claim>& claims) {
  judge_baseline(prr, by_command, claims);
  judge_singles(prr, claims);
  judge_bell(prr, claims);
}

}  // namespace tether
