#include "tools/experiment/claims.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace tether {
namespace {

constexpr char kPrr[] = "channel.prr";
constexpr char kDelay[] = "channel.delay_ms";
constexpr char kTau[] = "controller.tau_s";

/// Whether the mean lies within [low, high]; undecided if its interval also allows the contrary.
Claim::Verdict judge_mean(const Summary& summary, double low, double high) {
  const bool is_within = summary.mean >= low && summary.mean <= high;
  const Interval& i = summary.mean_interval;
  if (!std::isfinite(i.low))
    return is_within ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced;
  const bool all_within = i.low >= low && i.high <= high;
  const bool all_beyond = i.high < low || i.low > high;
  if (all_within) return Claim::Verdict::reproduced;
  return all_beyond ? Claim::Verdict::not_reproduced : Claim::Verdict::undecided;
}

Claim::Verdict worst(Claim::Verdict a, Claim::Verdict b) {
  if (a == Claim::Verdict::not_reproduced || b == Claim::Verdict::not_reproduced)
    return Claim::Verdict::not_reproduced;
  return a == Claim::Verdict::undecided ? a : b;
}

std::string mean_and_n(const Summary& summary) {
  return fmt::format("{} m (n = {})", mean_text(summary), summary.n);
}

/// A claim about the means at some values of a key.
Claim about_means(const SweepData& data, const std::string& figure, const std::string& paper,
                  const std::string& key, const std::vector<double>& values, double low,
                  double high) {
  Claim claim{figure, paper, "", Claim::Verdict::reproduced, ""};
  for (const double value : values) {
    const auto arm = data.find({{key, value}});
    if (!arm) continue;
    const Summary& summary = data.arms()[*arm].summary;
    claim.ours += fmt::format("{}{} {:g}: {}", claim.ours.empty() ? "" : "; ",
                              key == kPrr ? "PRR" : "δ [ms]", value, mean_and_n(summary));
    claim.verdict = worst(claim.verdict, judge_mean(summary, low, high));
  }
  if (claim.ours.empty()) claim.verdict = Claim::Verdict::undecided;
  if (claim.verdict == Claim::Verdict::undecided)
    claim.reason = "the interval reaches beyond the claim";
  return claim;
}

void judge_baseline(const SweepData& prr, std::vector<Claim>& claims) {
  claims.push_back(about_means(prr, "F2", "ε ≈ 1.8 m at PRR 1, τ = 2 s (1.7 to 1.95 m)", kPrr,
                               {1.0}, 1.7, 1.95));
  claims.push_back(about_means(prr, "F2", "below 2.6 m at PRR 0.85", kPrr, {0.85}, 0.0, 2.6));
  claims.push_back(about_means(prr, "F2", "mean ε of 20 to 24 m on the plateau, PRR 0.2 to 0.4",
                               kPrr, {0.2, 0.25, 0.3, 0.35, 0.4}, 20.0, 24.0));
  claims.push_back(
      about_means(prr, "F2", "ε of 12 to 20 m at PRR ≤ 0.1", kPrr, {0.05, 0.1}, 12.0, 20.0));
}

void judge_singles(const SweepData& prr, std::vector<Claim>& claims) {
  double largest = 0.0;
  std::size_t n = 0, high = 0;
  for (std::size_t arm = 0; arm < prr.arms().size(); ++arm) {
    const double x = prr.number(arm, kPrr);
    if (!(x >= 0.2 && x <= 0.4)) continue;
    for (const SeededValue& run : prr.arms()[arm].runs) {
      if (!std::isfinite(run.value)) continue;
      largest = std::max(largest, run.value);
      high += run.value >= 28.0 ? 1 : 0;
      ++n;
    }
  }
  if (n == 0) return;
  constexpr std::size_t kEnough = 100;  // fewer may have no such run among them by chance
  Claim::Verdict verdict = Claim::Verdict::not_reproduced;
  if (largest >= 28.0 && largest <= 31.0) verdict = Claim::Verdict::reproduced;
  if (largest < 28.0 && n < kEnough) verdict = Claim::Verdict::undecided;
  claims.push_back(
      {"F2", "single runs on the plateau reach 28 to 31 m",
       fmt::format("the largest of {} runs is {:.1f} m; {} are at 28 m or above", n, largest, high),
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
  const auto values = prr.values(kPrr);
  const auto least = prr.find({{kPrr, values.front()}}), most = prr.find({{kPrr, values.back()}});
  if (!least || !most || values.size() < 3) return;
  const auto& top = prr.arms()[peak];
  const auto drop = [&](std::size_t arm) {
    return paired_difference(top.runs, prr.arms()[arm].runs, kConfidence, kBootstrapSeed);
  };
  const auto left = drop(*least), right = drop(*most);
  const double x = prr.number(peak, kPrr);
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
       verdict, verdict == Claim::Verdict::undecided ? "more seeds are needed to tell" : ""});
}

void judge_delay(const SweepData& delay, std::vector<Claim>& claims) {
  claims.push_back(about_means(delay, "F3",
                               "ε of 2.0 to 2.3 m at 500 ms (the paper's figure: about 2.1 m)",
                               kDelay, {500.0}, 2.0, 2.3));
  const auto values = delay.values(kDelay);
  Claim claim{"F3", "ε rises with δ, almost linearly", "", Claim::Verdict::reproduced, ""};
  double sum_x = 0, sum_y = 0, sum_xx = 0, sum_xy = 0, sum_yy = 0, n = 0;
  std::optional<std::size_t> before;
  for (const double value : values) {
    const std::size_t arm = delay.find({{kDelay, value}}).value();
    const double y = delay.arms()[arm].summary.mean;
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
      mean_and_n(delay.arms()[delay.find({{kDelay, values.front()}}).value()].summary),
      values.front(), mean_and_n(delay.arms()[*before].summary), values.back(), 100.0 * r2);
  constexpr double kStraight = 0.98;  // a parabola reaches 0.93
  if (!(r2 >= kStraight)) {
    claim.verdict = Claim::Verdict::not_reproduced;
    claim.reason = "it rises, but not in a straight line";
  }
  claims.push_back(claim);
}

void judge_loss_against_delay(const SweepData& prr, const SweepData& delay,
                              std::vector<Claim>& claims) {
  const auto lossy = prr.find({{kPrr, 0.45}}), late = delay.find({{kDelay, 500.0}});
  if (!lossy || !late) return;
  const Summary& loss = prr.arms()[*lossy].summary;
  const Summary& lag = delay.arms()[*late].summary;
  const bool is_worse = loss.mean_interval.low > 2.0 * lag.mean;
  claims.push_back({"F2, F3", "loss hurts far more than delay",
                    fmt::format("PRR 0.45: {}; 500 ms: {}", mean_and_n(loss), mean_and_n(lag)),
                    is_worse ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced, ""});
}

/// The best τ of a column of the heatmap.
void judge_best_tau(const SweepData& heatmap, double prr, double tau_s, const std::string& paper,
                    std::vector<Claim>& claims) {
  const auto column = heatmap.where(kPrr, prr);
  std::vector<std::vector<SeededValue>> runs;
  for (const std::size_t arm : column) runs.push_back(heatmap.arms()[arm].runs);
  if (column.size() < 3) return;
  const BestArm best = ties_of_best(runs, kConfidence, kBootstrapSeed);
  if (!best.best) return;
  Claim claim{"F4", paper, "", Claim::Verdict::not_reproduced, ""};
  std::string ties;
  bool is_tied = false;
  for (std::size_t i = 0; i < column.size(); ++i) {
    const double tau = heatmap.number(column[i], kTau);
    const bool is_wanted = std::abs(tau - tau_s) < 1e-9;
    if (best.best == i && is_wanted) claim.verdict = Claim::Verdict::reproduced;
    if (best.tied[i] && best.best != i) {
      ties += fmt::format("{}{:g} s", ties.empty() ? "" : ", ", tau);
      is_tied = is_tied || is_wanted;
    }
  }
  const std::size_t winner = column[*best.best];
  claim.ours =
      fmt::format("best τ = {:g} s: {}; {}", heatmap.number(winner, kTau),
                  mean_and_n(heatmap.arms()[winner].summary),
                  ties.empty() ? "no other τ can compete" : "not separated from it: " + ties);
  const bool is_certain = ties.empty() || heatmap.arms()[winner].summary.sd == 0.0;
  if (claim.verdict == Claim::Verdict::reproduced && !is_certain)
    claim.verdict = Claim::Verdict::undecided;
  if (claim.verdict == Claim::Verdict::not_reproduced && is_tied)
    claim.verdict = Claim::Verdict::undecided;
  if (claim.verdict == Claim::Verdict::undecided) {
    claim.reason = "ε is flat in τ here within what the runs can tell";
  }
  claims.push_back(claim);
}

void judge_risk(const RiskFall& risk, std::vector<Claim>& claims) {
  const Interval& second = risk.fall[0];
  const Interval& last = risk.fall[1];
  Claim claim{
      "F5", "the risk falls along the path and is high before the first turns",
      fmt::format("mean ε of the runs in B there: {:.1f} m in the first third of the path, "
                  "{:.1f} m in the second, {:.1f} m in the last; lower than the first by {} "
                  "and {} m (n = {})",
                  risk.thirds[0], risk.thirds[1], risk.thirds[2], interval_text(second),
                  interval_text(last), risk.runs),
      Claim::Verdict::undecided, ""};
  if (second.low > 0.0 && last.low > 0.0) claim.verdict = Claim::Verdict::reproduced;
  if (second.high < 0.0 || last.high < 0.0) claim.verdict = Claim::Verdict::not_reproduced;
  claims.push_back(claim);
}

}  // namespace

std::string to_text(Claim::Verdict verdict) {
  switch (verdict) {
    case Claim::Verdict::reproduced:
      return "reproduced";
    case Claim::Verdict::not_reproduced:
      return "not reproduced";
    case Claim::Verdict::undecided:
      break;
  }
  return "undecided";
}

std::vector<Claim> judge_claims(const PaperResults& results) {
  std::vector<Claim> claims;
  if (results.prr) {
    judge_baseline(*results.prr, claims);
    judge_singles(*results.prr, claims);
    judge_bell(*results.prr, claims);
  }
  if (results.delay) judge_delay(*results.delay, claims);
  if (results.prr && results.delay) judge_loss_against_delay(*results.prr, *results.delay, claims);
  if (results.heatmap) {
    judge_best_tau(*results.heatmap, 1.0, 2.0, "at PRR 1 the best τ is 2 s; ε rises on both sides",
                   claims);
    judge_best_tau(*results.heatmap, 0.65, 2.0, "at PRR 0.65 the best τ is 2 s", claims);
    judge_best_tau(*results.heatmap, 0.45, 3.0, "at PRR 0.45 the best τ is 3 s", claims);
  }
  if (results.risk) judge_risk(*results.risk, claims);
  return claims;
}

}  // namespace tether
