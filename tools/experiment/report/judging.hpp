#pragma once

#include <string>
#include <vector>

#include "tools/experiment/report/claims.hpp"

namespace tether {

/// A number of the paper, and how accurately its text and figures give it: the band within which a
/// claim about it is reproduced. There is one band a number. It says what can be read there, and
/// was fixed by that alone, not by what comes out here.
struct Band {
  double centre_m, accuracy_m;
  constexpr double low_m() const { return centre_m - accuracy_m; }
  constexpr double high_m() const { return centre_m + accuracy_m; }
};

/// F2: "about 15 m", "up to about 23 m on average", "up to 30 m", on an axis of 30 m and a little
/// more: to a twentieth of it.
inline constexpr double kReadOfF2_m = 1.5;
inline constexpr Band kFewCommands{15.0, kReadOfF2_m};
inline constexpr Band kPlateau{23.0, kReadOfF2_m};
inline constexpr Band kWorstRun{30.0, kReadOfF2_m};

/// F3: from 1.8 to 2.1 m, given to two digits, on an axis that spans little more than these.
inline constexpr double kReadOfF3_m = 0.1;
inline constexpr Band kUnimpaired{1.8, kReadOfF3_m};
inline constexpr Band kAtLongestDelay{2.1, kReadOfF3_m};
/// Rise of F3 from no delay to 500 ms.
inline constexpr Band kRiseWithDelay{0.3, kReadOfF3_m};

/// Not a number of the paper: F2 is nearly down again at PRR 0.85.
inline constexpr double kNearlyDown_m = 2.6;

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
