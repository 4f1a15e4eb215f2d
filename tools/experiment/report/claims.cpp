#include "tools/experiment/report/claims.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/experiment/report/paper_readings.hpp"

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

std::string reason_of(Claim::Verdict verdict) {
  if (verdict == Claim::Verdict::undecided) return "the interval reaches beyond the claim";
  return verdict == Claim::Verdict::not_reproduced ? "outside, beyond chance" : "";
}

std::string mean_and_n(const Summary& summary) {
  return fmt::format("{} m (n = {})", mean_text(summary), summary.n);
}

/// An arm's mean; the better one where there is one (PaperResults::prr_by_command).
struct ArmMean {
  Summary summary;
  std::string text;

  ArmMean(const SweepData& data, std::size_t arm, const std::vector<CommandedRuns>& by_command)
      : summary(data.arms()[arm].summary), text(mean_and_n(summary)) {
    if (arm >= by_command.size() || !std::isfinite(by_command[arm].epsilon_m.mean)) return;
    const CommandedRuns& runs = by_command[arm];
    summary.mean = runs.epsilon_m.mean;
    summary.mean_interval = runs.epsilon_m.interval;
    text = fmt::format(
        "{} m (n = {}; {:.0f} % never get a command, weighed as the {:.1f} % that "
        "chance gives)",
        mean_text(summary), runs.runs,
        100.0 * static_cast<double>(runs.never) / static_cast<double>(runs.runs),
        100.0 * runs.probability.value());
  }
};

/// A claim about the means at some values of a key.
Claim about_means(const SweepData& data, const std::string& figure, const std::string& paper,
                  const std::string& key, const std::vector<double>& values, double low,
                  double high, const std::vector<CommandedRuns>& by_command = {}) {
  Claim claim{figure, paper, "", Claim::Verdict::reproduced, ""};
  std::string missing;
  for (const double value : values) {
    const auto arm = data.find({{key, value}});
    if (!arm) {
      missing += fmt::format("{}{:g}", missing.empty() ? "no runs at " : ", ", value);
      continue;
    }
    const ArmMean mean(data, *arm, by_command);
    claim.ours += fmt::format("{}{} {:g}: {}", claim.ours.empty() ? "" : "; ",
                              key == kPrr ? "PRR" : "δ [ms]", value, mean.text);
    claim.verdict = worst(claim.verdict, judge_mean(mean.summary, low, high));
  }
  claim.reason = reason_of(claim.verdict);
  if (!missing.empty()) {
    claim.verdict = worst(claim.verdict, Claim::Verdict::undecided);
    claim.reason = missing;
  }
  return claim;
}

std::string band_text(const Band& band) {
  return fmt::format("{:g} ± {:g} m", band.centre_m, band.accuracy_m);
}

/// A claim about the largest of the means, as the paper says "up to".
Claim about_plateau(const SweepData& prr) {
  const std::vector<double> prrs{0.2, 0.25, 0.3, 0.35, 0.4};
  const std::string paper = fmt::format(
      "mean ε up to 23 m on the plateau, PRR 0.2 to 0.4 (the largest: {})", band_text(kPlateau));
  Claim claim = about_means(prr, "F2", paper, kPrr, prrs, 0.0, kPlateau.high_m());
  if (claim.reason.starts_with("no runs")) return claim;
  const Summary* largest = nullptr;
  for (const double value : prrs) {
    const Summary& summary = prr.arms()[prr.find({{kPrr, value}}).value()].summary;
    if (largest == nullptr || summary.mean > largest->mean) largest = &summary;
  }
  claim.verdict = judge_mean(*largest, kPlateau.low_m(), kPlateau.high_m());
  claim.reason = reason_of(claim.verdict);
  return claim;
}

void judge_baseline(const SweepData& prr, const std::vector<CommandedRuns>& by_command,
                    std::vector<Claim>& claims) {
  claims.push_back(about_means(
      prr, "F2", fmt::format("ε ≈ 1.8 m at PRR 1, τ = 2 s ({})", band_text(kUnimpaired)), kPrr,
      {1.0}, kUnimpaired.low_m(), kUnimpaired.high_m()));
  claims.push_back(about_means(prr, "F2", fmt::format("below {:g} m at PRR 0.85", kNearlyDown_m),
                               kPrr, {0.85}, 0.0, kNearlyDown_m));
  claims.push_back(about_plateau(prr));
  claims.push_back(
      about_means(prr, "F2", fmt::format("ε ≈ 15 m at PRR ≤ 0.1 ({})", band_text(kFewCommands)),
                  kPrr, {0.05, 0.1}, kFewCommands.low_m(), kFewCommands.high_m(), by_command));
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
       verdict,
       verdict == Claim::Verdict::undecided        ? "more seeds are needed to tell"
       : verdict == Claim::Verdict::not_reproduced ? "the largest mean is elsewhere"
                                                   : ""});
}

/// From no delay to half a second, by the same seeds.
void judge_rise_with_delay(const SweepData& delay, std::vector<Claim>& claims) {
  const auto none = delay.find({{kDelay, 0.0}}), longest = delay.find({{kDelay, 500.0}});
  if (!none || !longest) return;
  const Summary rise = paired_difference(delay.arms()[*longest].runs, delay.arms()[*none].runs,
                                         kConfidence, kBootstrapSeed)
                           .difference;
  const auto verdict = judge_mean(rise, kRiseWithDelay.low_m(), kRiseWithDelay.high_m());
  claims.push_back({"F3", fmt::format("ε rises by {} over 500 ms", band_text(kRiseWithDelay)),
                    fmt::format("by {} (paired)", mean_and_n(rise)), verdict, reason_of(verdict)});
}

void judge_delay(const SweepData& delay, std::vector<Claim>& claims) {
  claims.push_back(about_means(delay, "F3",
                               fmt::format("ε ≈ 2.1 m at 500 ms ({})", band_text(kAtLongestDelay)),
                               kDelay, {500.0}, kAtLongestDelay.low_m(), kAtLongestDelay.high_m()));
  judge_rise_with_delay(delay, claims);
  const auto values = delay.values(kDelay);
  Claim claim{"F3", "ε rises with δ, almost linearly", "", Claim::Verdict::reproduced, ""};
  double sum_x = 0, sum_y = 0, sum_xx = 0, sum_xy = 0, sum_yy = 0, n = 0;
  std::optional<std::size_t> before;
  for (const double value : values) {
    const std::size_t arm = delay.find({{kDelay, value}}).value();
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
      mean_and_n(delay.arms()[delay.find({{kDelay, values.front()}}).value()].summary),
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
  const auto lossy = prr.find({{kPrr, 0.45}}), late = delay.find({{kDelay, 500.0}});
  if (!lossy || !late) return;
  const Summary& loss = prr.arms()[*lossy].summary;
  const Summary& lag = delay.arms()[*late].summary;
  const bool is_worse = loss.mean_interval.low > 2.0 * lag.mean;
  claims.push_back({"F2, F3", "loss hurts far more than delay",
                    fmt::format("PRR 0.45: {}; 500 ms: {}", mean_and_n(loss), mean_and_n(lag)),
                    is_worse ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced,
                    is_worse ? "" : "less than twice as much, or not beyond chance"});
}

/// Whether ε rises from arm to arm. It does not where the second arm's ε is not larger and chance
/// cannot explain that; undecided where chance can.
Claim::Verdict judge_step(const SweepData& data, std::size_t from, std::size_t to) {
  const auto step =
      paired_difference(data.arms()[to].runs, data.arms()[from].runs, kConfidence, kBootstrapSeed);
  if (!step.separated) return Claim::Verdict::undecided;
  return step.difference.mean > 0.0 ? Claim::Verdict::reproduced : Claim::Verdict::not_reproduced;
}

/// A column of the heatmap, by ascending τ.
struct TauColumn {
  std::vector<std::size_t> arms;
  BestArm best;

  TauColumn(const SweepData& heatmap, double prr) : arms(heatmap.where(kPrr, prr)) {
    std::sort(arms.begin(), arms.end(), [&heatmap](std::size_t a, std::size_t b) {
      return heatmap.number(a, kTau) < heatmap.number(b, kTau);
    });
    std::vector<std::vector<SeededValue>> runs;
    for (const std::size_t arm : arms) runs.push_back(heatmap.arms()[arm].runs);
    best = ties_of_best(runs, kConfidence, kBootstrapSeed);
  }
};

/// Whether `tau_s` is the best τ of a column; undecided where the data cannot tell it from the
/// best.
Claim judge_best_tau(const SweepData& heatmap, const TauColumn& column, double tau_s,
                     const std::string& paper) {
  const std::size_t best = column.best.best.value();
  Claim claim{"F4", paper, "", Claim::Verdict::not_reproduced, ""};
  std::string ties;
  bool is_tied = false;
  for (std::size_t i = 0; i < column.arms.size(); ++i) {
    const double tau = heatmap.number(column.arms[i], kTau);
    if (!column.best.tied[i]) continue;
    is_tied = is_tied || std::abs(tau - tau_s) < 1e-9;
    if (i != best) ties += fmt::format("{}{:g} s", ties.empty() ? "" : ", ", tau);
  }
  const std::size_t winner = column.arms[best];
  claim.ours =
      fmt::format("best τ = {:g} s: {}; {}", heatmap.number(winner, kTau),
                  mean_and_n(heatmap.arms()[winner].summary),
                  ties.empty() ? "all others are worse" : "not separated from it: " + ties);
  if (is_tied)
    claim.verdict = ties.empty() ? Claim::Verdict::reproduced : Claim::Verdict::undecided;
  if (claim.verdict == Claim::Verdict::undecided) {
    claim.reason = "the runs cannot tell which of these is the best";
  }
  if (!is_tied) claim.reason = fmt::format("{:g} s is worse, beyond chance", tau_s);
  return claim;
}

/// ε rises step by step on both sides of the best τ.
void judge_rise_on_both_sides(const SweepData& heatmap, const TauColumn& column, Claim& claim) {
  const std::size_t best = column.best.best.value();
  Claim::Verdict rise = Claim::Verdict::reproduced;
  for (std::size_t i = 0; i + 1 < column.arms.size(); ++i) {
    const std::size_t low = column.arms[i], high = column.arms[i + 1];
    rise = worst(rise, i < best ? judge_step(heatmap, high, low) : judge_step(heatmap, low, high));
  }
  if (best == 0 || best + 1 == column.arms.size()) rise = Claim::Verdict::not_reproduced;
  claim.verdict = worst(claim.verdict, rise);
  const auto end = [&](std::size_t arm) {
    return fmt::format("{} at {:g} s", mean_and_n(heatmap.arms()[arm].summary),
                       heatmap.number(arm, kTau));
  };
  claim.ours += fmt::format("; {}, {}", end(column.arms.front()), end(column.arms.back()));
  if (rise == Claim::Verdict::reproduced || !claim.reason.empty()) return;
  claim.reason = rise == Claim::Verdict::undecided ? "the runs cannot tell whether each step rises"
                                                   : "it does not rise on both sides";
}

void judge_heatmap(const SweepData& heatmap, std::vector<Claim>& claims) {
  struct Wanted {
    double prr, tau_s;
    const char* paper;
  };
  for (const Wanted& wanted :
       {Wanted{1.0, 2.0, "at PRR 1 the best τ is 2 s; ε rises on both sides"},
        Wanted{0.65, 2.0, "at PRR 0.65 the best τ is 2 s"},
        Wanted{0.45, 3.0, "at PRR 0.45 the best τ is 3 s"}}) {
    const TauColumn column(heatmap, wanted.prr);
    if (column.arms.size() < 3 || !column.best.best) continue;
    claims.push_back(judge_best_tau(heatmap, column, wanted.tau_s, wanted.paper));
    if (wanted.prr == 1.0) judge_rise_on_both_sides(heatmap, column, claims.back());
  }
}

Claim::Verdict judge_fall(const MeanEstimate& fall) {
  if (fall.interval.low > 0.0) return Claim::Verdict::reproduced;
  return fall.interval.high < 0.0 ? Claim::Verdict::not_reproduced : Claim::Verdict::undecided;
}

std::string estimate_text(const MeanEstimate& e) {
  return fmt::format("{:.1f} {}", e.mean, interval_text(e.interval));
}

void judge_risk(const RiskFall& risk, std::vector<Claim>& claims) {
  Claim falls{"F5", "the risk falls along the path",
              fmt::format("risk as the {}: {} m in the first third of the path, {} m in the "
                          "second, {} m in the last; falls from the first by {} and {} m (n = {})",
                          to_text(risk.definition), estimate_text(risk.thirds[0]),
                          estimate_text(risk.thirds[1]), estimate_text(risk.thirds[2]),
                          estimate_text(risk.to_second), estimate_text(risk.to_last), risk.runs),
              worst(judge_fall(risk.to_second), judge_fall(risk.to_last)), ""};
  constexpr char kReading[] = "the paper does not define its risk; --risk chooses other readings";
  if (risk.definition != RiskDefinition::whole_run) falls.reason = kReading;
  if (falls.verdict == Claim::Verdict::not_reproduced && falls.reason.empty())
    falls.reason = "it rises";
  claims.push_back(falls);
  if (!std::isfinite(risk.before_turns.mean)) return;
  claims.push_back(
      {"F5", "the risk is high before the first turns",
       fmt::format("{} m before the first sharp turn, higher than from there on by {} "
                   "m (n = {})",
                   estimate_text(risk.before_turns), estimate_text(risk.to_rest), risk.runs),
       judge_fall(risk.to_rest), risk.definition == RiskDefinition::whole_run ? "" : kReading});
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
    judge_baseline(*results.prr, results.prr_by_command, claims);
    judge_singles(*results.prr, claims);
    judge_bell(*results.prr, claims);
  }
  if (results.delay) judge_delay(*results.delay, claims);
  if (results.prr && results.delay) judge_loss_against_delay(*results.prr, *results.delay, claims);
  if (results.heatmap) judge_heatmap(*results.heatmap, claims);
  if (results.risk) judge_risk(*results.risk, claims);
  return claims;
}

}  // namespace tether
