#include "tools/experiment/report/claims.hpp"

#include "tools/experiment/report/judging.hpp"

namespace tether {

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
  if (results.prr) judge_loss(*results.prr, results.prr_by_command, claims);
  if (results.delay) judge_delay(*results.delay, claims);
  if (results.prr && results.delay) judge_loss_against_delay(*results.prr, *results.delay, claims);
  if (results.heatmap) judge_heatmap(*results.heatmap, claims);
  if (results.risk) judge_risk(*results.risk, claims);
  return claims;
}

}  // namespace tether
