#pragma once

#include <string>
#include <vector>

#include "tools/experiment/report/claims.hpp"
#include "tools/experiment/report/paper_readings.hpp"

namespace tether {

// Parts of judge_claims(): what the figures' claims share, and each figure's claims.

inline constexpr char kPrrKey[] = "channel.prr";
inline constexpr char kDelayKey[] = "channel.delay_ms";
inline constexpr char kTauKey[] = "controller.tau_s";

/// Whether the mean lies within [low, high]; undecided if its interval also allows the contrary.
Claim::Verdict judge_mean(const Summary& summary, double low, double high);
/// Verdict of a claim of two parts.
Claim::Verdict worst(Claim::Verdict a, Claim::Verdict b);
/// Why a mean's verdict is so.
std::string reason_of(Claim::Verdict verdict);

/// "2.19 [1.82, 3.62] m (n = 60)".
std::string mean_and_n(const Summary& summary);
/// "15 ± 1.5 m".
std::string band_text(const Band& band);

/// A claim about the means at some values of a key.
Claim about_means(const SweepData& data, const std::string& figure, const std::string& paper,
                  const std::string& key, const std::vector<double>& values, double low,
                  double high, const std::vector<CommandedRuns>& by_command = {});

/// F2. Each of these adds what the data let it judge.
void judge_loss(const SweepData& prr, const std::vector<CommandedRuns>& by_command,
                std::vector<Claim>& claims);
/// F3.
void judge_delay(const SweepData& delay, std::vector<Claim>& claims);
/// F2 and F3.
void judge_loss_against_delay(const SweepData& prr, const SweepData& delay,
                              std::vector<Claim>& claims);
/// F4.
void judge_heatmap(const SweepData& heatmap, std::vector<Claim>& claims);
/// F5.
void judge_risk(const RiskFall& risk, std::vector<Claim>& claims);

}  // namespace tether
