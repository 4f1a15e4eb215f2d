#include <fmt/format.h>

#include <cmath>

#include "tools/experiment/report/judging.hpp"

namespace tether {
namespace {

Claim::Verdict judge_fall(const MeanEstimate& fall) {
  if (fall.interval.low > 0.0) return Claim::Verdict::reproduced;
  return fall.interval.high < 0.0 ? Claim::Verdict::not_reproduced : Claim::Verdict::undecided;
}

std::string estimate_text(const MeanEstimate& e) {
  return fmt::format("{:.1f} {}", e.mean, interval_text(e.interval));
}

}  // namespace

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

}  // namespace tether
