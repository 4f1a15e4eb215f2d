#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/experiment/report/judging.hpp"

namespace tether {
namespace {

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

  TauColumn(const SweepData& heatmap, double prr) : arms(heatmap.where(kPrrKey, prr)) {
    std::sort(arms.begin(), arms.end(), [&heatmap](std::size_t a, std::size_t b) {
      return heatmap.number(a, kTauKey) < heatmap.number(b, kTauKey);
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
    const double tau = heatmap.number(column.arms[i], kTauKey);
    if (!column.best.tied[i]) continue;
    is_tied = is_tied || std::abs(tau - tau_s) < 1e-9;
    if (i != best) ties += fmt::format("{}{:g} s", ties.empty() ? "" : ", ", tau);
  }
  const std::size_t winner = column.arms[best];
  claim.ours =
      fmt::format("best τ = {:g} s: {}; {}", heatmap.number(winner, kTauKey),
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
                       heatmap.number(arm, kTauKey));
  };
  claim.ours += fmt::format("; {}, {}", end(column.arms.front()), end(column.arms.back()));
  if (rise == Claim::Verdict::reproduced || !claim.reason.empty()) return;
  claim.reason = rise == Claim::Verdict::undecided ? "the runs cannot tell whether each step rises"
                                                   : "it does not rise on both sides";
}

}  // namespace

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

}  // namespace tether
