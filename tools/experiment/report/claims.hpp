#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tools/experiment/report/risk.hpp"
#include "tools/experiment/sweep/data.hpp"
#include "tools/experiment/sweep/never_commanded.hpp"

namespace tether {

/// A claim of the paper, and the result here.
struct Claim {
  enum class Verdict : std::uint8_t { reproduced, not_reproduced, undecided };

  std::string figure;  ///< "F2"
  std::string paper;   ///< claim of the paper, or a deduction from it
  std::string ours;    ///< numbers, with 95 % intervals and numbers of runs
  Verdict verdict = Verdict::undecided;
  std::string reason;  ///< why it is so; empty where `ours` says it all
};

std::string to_text(Claim::Verdict verdict);

/// The results that claims are about; those that are not there are not judged.
struct PaperResults {
  std::optional<SweepData> prr;  ///< F2: ε by channel.prr
  /// F2's arms in their order: their means, where these are finite, are better ones.
  std::vector<CommandedRuns> prr_by_command;
  std::optional<SweepData> delay;    ///< F3: ε by channel.delay_ms
  std::optional<SweepData> heatmap;  ///< F4: ε by channel.prr and controller.tau_s
  std::optional<RiskFall> risk;      ///< F5
};

/// All of the paper's claims that the results let us judge, in the order of its figures. A claim
/// about a mean is judged by the mean with its interval, never by one number alone: it is undecided
/// where the interval reaches beyond the claimed range or, from without, into it.
std::vector<Claim> judge_claims(const PaperResults& results);

}  // namespace tether
