#include "tools/experiment/report/judging.hpp"

#include <fmt/format.h>

#include <cmath>

namespace tether {
namespace {

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

}  // namespace

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

std::string band_text(const Band& band) {
  return fmt::format("{:g} ± {:g} m", band.centre_m, band.accuracy_m);
}

Claim about_means(const SweepData& data, const std::string& figure, const std::string& paper,
                  const std::string& key, const std::vector<double>& values, double low,
                  double high, const std::vector<CommandedRuns>& by_command) {
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
                              key == kPrrKey ? "PRR" : "δ [ms]", value, mean.text);
    claim.verdict = worst(claim.verdict, judge_mean(mean.summary, low, high));
  }
  claim.reason = reason_of(claim.verdict);
  if (!missing.empty()) {
    claim.verdict = worst(claim.verdict, Claim::Verdict::undecided);
    claim.reason = missing;
  }
  return claim;
}

}  // namespace tether
