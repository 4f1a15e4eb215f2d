#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <optional>

#include "netem/check/tc_export.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

using Law = JitterConfig::Law;

// iproute2's tables: value = T + J·entry/8192, 4096 entries, drawn uniformly. Pareto: entry/8192 =
// (4/3)(Y − 1.5), P[Y > y] = y^−3, cut at 4; measured on Debian 12's pareto.dist: mean −0.0335,
// standard deviation 0.820 (uncut 1.1547). Paretonormal: 0.25 Z + 0.75 of that; −0.0253, 0.834
// (uncut 1.05177).
constexpr double kParetoSd = 1.1547005383792515;       // 2/√3
constexpr double kParetonormalSd = 1.051771923566881;  // of 0.25 Z + (Y − 1.5)
constexpr double kMostJitter_ms = 2147.483647;         // the kernel cuts J there

/// A jitter law as tc has it.
struct TcJitter {
  double jitter_ms = 0.0;
  std::string distribution;  ///< "": uniform on T ± J
  std::string note;
  std::string missing;  ///< why there is none
};

TcJitter pareto_jitter(const JitterConfig& jitter, bool mixed) {
  TcJitter tc;
  if (jitter.shape != 3.0) {
    tc.missing = "tc's table has the tail index 3";
    return tc;
  }
  tc.jitter_ms = jitter.sd_ms / (mixed ? kParetonormalSd : kParetoSd);
  tc.distribution = mixed ? "paretonormal" : "pareto";
  tc.note = fmt::format(
      "{}: J = sd/{}; tc's table ends at T {:+.3g} ms and {:+.3g} ms (the law itself has no upper "
      "end), which takes {:.3g} ms from the mean and leaves a standard deviation of {:.3g} ms",
      tc.distribution, mixed ? "1.0518" : "1.1547", (mixed ? -1.502 : -0.667) * tc.jitter_ms,
      (mixed ? 3.881 : 4.0) * tc.jitter_ms, (mixed ? 0.0253 : 0.0335) * tc.jitter_ms,
      (mixed ? 0.834 : 0.820) * tc.jitter_ms);
  return tc;
}

TcJitter tc_jitter(const JitterConfig& jitter) {
  TcJitter tc;
  switch (jitter.law) {
    case Law::none:
    case Law::constant:
      break;
    case Law::uniform:
      tc.jitter_ms = std::numbers::sqrt3 * jitter.sd_ms;
      break;
    case Law::normal:
      tc.jitter_ms = jitter.sd_ms;
      tc.distribution = "normal";
      tc.note = fmt::format("normal: tc's table ends at T {:+.3g} ms and {:+.3g} ms",
                            -4.0 * jitter.sd_ms, 3.523 * jitter.sd_ms);
      break;
    case Law::pareto:
    case Law::paretonormal:
      return pareto_jitter(jitter, jitter.law == Law::paretonormal);
    case Law::gamma:
      tc.missing = "tc has no table of gamma laws";
      break;
    case Law::table:
      tc.missing = "tc reads tables of another kind (maketable of iproute2's sources makes them)";
      break;
  }
  if (tc.jitter_ms > kMostJitter_ms) tc.missing = "netem cuts J at 2147 ms";
  return tc;
}

/// Why tc refuses the law with this mean delay; "" if it does not.
std::string refusal(const TcJitter& tc, double mean_ms) {
  if (!tc.missing.empty()) return tc.missing;
  if (mean_ms < 0.0) return "tc takes no negative delay";
  if (mean_ms == 0.0 && !tc.distribution.empty()) return "tc wants a delay with it";
  return "";
}

/// Appends `delay`. Returns whether delays vary.
bool export_delay(const LinkConfig& link, double state_ms, TcExport& out) {
  const bool has_mean = link.jitter.law != Law::none && link.jitter.law != Law::table;
  const double mean_ms = state_ms + (has_mean ? link.jitter.mean_ms : 0.0);
  const TcJitter tc = tc_jitter(link.jitter);
  if (tc.jitter_ms <= 0.0 && tc.missing.empty()) {
    if (mean_ms > 0.0) out.command += " delay " + tc_time(mean_ms);
    return false;
  }
  const std::string refused = refusal(tc, mean_ms);
  if (!refused.empty()) {
    out.notes.push_back(fmt::format("jitter is left out, {}: {}",
                                    has_mean ? "but for its mean" : "mean included", refused));
    if (mean_ms > 0.0) out.command += " delay " + tc_time(mean_ms);
    return false;
  }
  out.command += fmt::format(" delay {} {}", tc_time(mean_ms), tc_time(tc.jitter_ms));
  if (!tc.distribution.empty()) out.command += " distribution " + tc.distribution;
  if (!tc.note.empty()) out.notes.push_back(tc.note);
  if (link.jitter.correlation != 0.0) {
    out.notes.push_back(fmt::format(
        "jitter.correlation = {:g} has no equivalent: tc's averages successive random numbers, "
        "which changes the law",
        link.jitter.correlation));
  }
  return true;
}

void export_rate(const LinkConfig& link, const TcSender& sender, bool varies, TcExport& out) {
  if (link.rate.bits_per_s <= 0.0) return;
  const double overhead =
      static_cast<double>(link.rate.overhead_bytes) - frame_overhead_bytes(sender.channel);
  out.command += fmt::format(" rate {:.0f}bit {:.0f}", link.rate.bits_per_s, overhead);
  out.notes.push_back(
      fmt::format("rate: tc counts Ethernet, IP, UDP and LCM headers ({:.0f} bytes with {}), which "
                  "the overhead "
                  "of {:.0f} takes off again",
                  frame_overhead_bytes(sender.channel), sender.channel, overhead));
  if (varies) {
    out.notes.emplace_back(
        "rate: netem's bottleneck lies behind the delay and lets none overtake; Tether's lies "
        "before it, and packets overtake each other when delays fall");
  }
}

void export_order(const LinkConfig& link, bool varies, TcExport& out) {
  const bool limited = link.rate.bits_per_s > 0.0;
  if (varies && link.in_order && !limited) {
    out.command += " rate 100gbit";
    out.notes.emplace_back(
        "in_order: any rate makes netem keep the order; its queue sorts packets by their time, so "
        "a "
        "pfifo child would not");
  } else if (varies && !limited) {
    out.notes.emplace_back(
        "packets overtake each other when delays fall, with tc as with Tether (in_order = false)");
  }
  const ReorderConfig& reorder = link.reorder;
  if (reorder.probability <= 0.0) return;
  if (out.command.find(" delay ") == std::string::npos) {
    out.notes.emplace_back("reorder is left out: tc wants a delay that packets can skip");
    return;
  }
  out.command += " reorder " + tc_percent(reorder.probability);
  if (reorder.gap > 1) {
    out.command += fmt::format(" gap {}", reorder.gap);
    out.notes.emplace_back("reorder: netem counts the gap without the packets that it loses");
  }
  if (limited) out.notes.emplace_back("reorder: these packets skip netem's rate limit as well");
}

}  // namespace

void export_tc_timing(const LinkConfig& link, const TcSender& sender, TcExport& out) {
  const auto only_delay_ms = kind_of(link).only_delay_ms;
  const auto state_ms = only_delay_ms != nullptr ? only_delay_ms(link) : std::optional(0.0);
  if (!state_ms) {
    out.notes.emplace_back(
        "delays that depend on the state have no equivalent: the states' delays are left out");
  }
  const bool varies = export_delay(link, state_ms.value_or(0.0), out);
  export_rate(link, sender, varies, out);
  export_order(link, varies, out);
}

}  // namespace tether
