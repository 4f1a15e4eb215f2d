#include "netem/models/link_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"

namespace tether {
namespace {

using Model = LinkConfig::Model;
using Law = JitterConfig::Law;

constexpr std::size_t kMaxStates = 64;
constexpr double kShortest_s = 1e-3;  // stay in a state of a chain in time; as kSojourn
constexpr double kRounding = 1e-9;    // of probabilities written in decimal

constexpr const char* kModelNames[] = {"fixed", "markov", "gilbert_elliott", "four_state", "chain",
                                       "trace", "map"};

const char* name_of(Law law) {
  constexpr const char* kNames[] = {"none",   "constant",     "uniform", "normal",
                                    "pareto", "paretonormal", "gamma",   "table"};
  return kNames[static_cast<std::size_t>(law)];
}

bool is_model_part(const std::string& part, Model model) {
  return part.starts_with(std::string(kModelNames[static_cast<std::size_t>(model)]) + ".");
}

bool jitter_uses(const JitterConfig& jitter, const std::string& name) {
  const Law law = jitter.law;
  if (name == "law") return true;
  if (name == "table_ms" || name == "file") return law == Law::table;
  if (name == "shape") return law == Law::pareto || law == Law::paretonormal;
  if (name == "mean_ms") return law != Law::none && law != Law::table;
  return law != Law::none && law != Law::constant && (name == "correlation" || law != Law::table);
}

/// Parts that do nothing while a switch of the same stage is off.
std::string why_stage_is_off(const std::string& prefix, const LinkConfig& link,
                             const std::string& part) {
  const auto is_zero = [&prefix](const char* key) { return fmt::format("{}{} is 0", prefix, key); };
  if (part.starts_with("jitter.") && !jitter_uses(link.jitter, part.substr(7))) {
    return fmt::format("{}jitter.law is \"{}\"", prefix, name_of(link.jitter.law));
  }
  if (part == "corrupt.bits" && link.corrupt.probability == 0.0) {
    return is_zero("corrupt.probability");
  }
  if (part == "reorder.gap" && link.reorder.probability == 0.0) {
    return is_zero("reorder.probability");
  }
  if (part.starts_with("rate.") && part != "rate.bits_per_s" && link.rate.bits_per_s == 0.0) {
    return is_zero("rate.bits_per_s");
  }
  if (part.starts_with("slot.") && part != "slot.period_ms" && link.slot.period_ms == 0.0) {
    return is_zero("slot.period_ms");
  }
  if (part == "chain.step_s" && link.chain.probabilities.empty()) {
    return fmt::format("{}chain.probabilities is not given", prefix);
  }
  return "";
}

void resolve_sojourn_times(const std::string& prefix, LinkConfig& link,
                           const ScenarioLevel& level) {
  if (!link.p_bad && !link.mean_cycle_s) return;
  const std::string stationary = fmt::format("{0}markov.p_bad and {0}markov.mean_cycle_s", prefix);
  if (level.has(prefix + "markov.mean_good_s") || level.has(prefix + "markov.mean_bad_s")) {
    throw UsageError(fmt::format("{}: give either {}, or {}markov.mean_good_s and mean_bad_s",
                                 level.source, stationary, prefix));
  }
  // One of the two alone keeps the other as it was.
  const double old_cycle_s = link.mean_good_s + link.mean_bad_s;
  const double cycle_s = link.mean_cycle_s.value_or(old_cycle_s);
  const double mean_bad_s = link.p_bad.value_or(link.mean_bad_s / old_cycle_s) * cycle_s;
  level.set_derived(prefix + "markov.mean_bad_s", mean_bad_s, stationary);
  level.set_derived(prefix + "markov.mean_good_s", cycle_s - mean_bad_s, stationary);
  link.p_bad.reset();
  link.mean_cycle_s.reset();
}

/// PRR and mean burst length to p and r: the formulas of netem/models/gilbert_elliott.hpp.
void resolve_burst(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  GilbertElliottConfig& ge = link.gilbert_elliott;
  if (!ge.prr && !ge.mean_burst) return;
  const std::string key = prefix + "gilbert_elliott.";
  for (const char* other : {"p", "r", "one_minus_h", "one_minus_k"}) {
    if (!level.has(key + other)) continue;
    throw UsageError(
        fmt::format("{0}: give either {1}prr and {1}mean_burst, or {1}p, r, one_minus_h and "
                    "one_minus_k",
                    level.source, key));
  }
  // One of the two alone keeps the other as it was.
  const bool simple = ge.p && ge.r && *ge.r > 0.0 && ge.one_minus_h == 1.0 && ge.one_minus_k == 0.0;
  if (!simple && !(ge.prr && ge.mean_burst)) {
    throw UsageError(
        fmt::format("{0}: {1}prr and {1}mean_burst are needed together", level.source, key));
  }
  const double prr = ge.prr ? *ge.prr : *ge.r / (*ge.p + *ge.r);
  const double burst = ge.mean_burst ? *ge.mean_burst : 1.0 / *ge.r;
  const double shortest = std::max(1.0, (1.0 - prr) / prr);
  if (burst < shortest * (1.0 - kRounding)) {
    throw UsageError(fmt::format(
        "{0}: {1}mean_burst = {2} is too short for {1}prr = {3}: must be at least max(1, "
        "(1-prr)/prr) = {4}, because even single packets received between bursts leave a share of "
        "1/(1 + mean_burst)",
        level.source, key, burst, prr, shortest));
  }
  const std::string from = fmt::format("{0}prr and {0}mean_burst", key);
  level.set_derived(key + "p", std::min(1.0, (1.0 - prr) / (prr * burst)), from);
  level.set_derived(key + "r", std::min(1.0, 1.0 / burst), from);
  ge.one_minus_h = 1.0;
  ge.one_minus_k = 0.0;
  ge.prr.reset();
  ge.mean_burst.reset();
}

class LinkChecker {
 public:
  LinkChecker(std::string prefix, const LinkConfig& link, const std::string& source)
      : prefix_(std::move(prefix)), link_(link), source_(source) {}

  void check() const {
    if (link_.model == Model::gilbert_elliott) check_gilbert_elliott();
    if (link_.model == Model::four_state) check_four_state();
    if (link_.model == Model::chain) check_chain();
    check_outages();
    check_jitter();
    if (link_.in_order && link_.reorder.probability > 0.0) {
      refuse("{0}in_order = true and {0}reorder.probability = {1} contradict each other", prefix_,
             link_.reorder.probability);
    }
    if (link_.slot.jitter_ms > link_.slot.period_ms) {
      refuse("{0}slot.jitter_ms = {1} must not be above {0}slot.period_ms = {2}", prefix_,
             link_.slot.jitter_ms, link_.slot.period_ms);
    }
  }

 private:
  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    throw UsageError(source_ + ": " + fmt::format(text, std::forward<Args>(args)...));
  }

  void check_gilbert_elliott() const {
    const GilbertElliottConfig& ge = link_.gilbert_elliott;
    if (ge.p && ge.r) return;
    refuse("{0}model = \"gilbert_elliott\" needs {0}gilbert_elliott.p and r, or prr and mean_burst",
           prefix_);
  }

  void check_four_state() const {
    const FourStateConfig& f = link_.four_state;
    const std::string key = prefix_ + "four_state.";
    if (!f.p13) refuse("{0}model = \"four_state\" needs {1}p13", prefix_, key);
    if (*f.p13 + f.p14 > 1.0 + kRounding) {
      refuse("{0}p13 + p14 = {1} must not be above 1: both leave state 1", key, *f.p13 + f.p14);
    }
    const double p31 = f.p31.value_or(1.0 - *f.p13);
    if (p31 + f.p32 > 1.0 + kRounding) {
      refuse(
          "{0}p31 + p32 = {1} must not be above 1: both leave state 3 (p31 is 1 - p13 if not "
          "given)",
          key, p31 + f.p32);
    }
  }

  void check_chain() const {
    const ChainConfig& chain = link_.chain;
    const std::string key = prefix_ + "chain.";
    const std::size_t n = chain.prr.size();
    if (n == 0) refuse("{0}model = \"chain\" needs {1}prr, an entry per state", prefix_, key);
    if (n > kMaxStates) refuse("{0}prr: at most {1} states, not {2}", key, kMaxStates, n);
    if (!chain.delay_ms.empty() && chain.delay_ms.size() != n) {
      refuse("{0}delay_ms needs {1} entries, as many as {0}prr, not {2}", key, n,
             chain.delay_ms.size());
    }
    if (chain.rates_per_s.empty() == chain.probabilities.empty()) {
      refuse("{0}model = \"chain\" needs one of {1}rates_per_s and {1}probabilities", prefix_, key);
    }
    if (chain.step_s > 0.0 && chain.step_s < kShortest_s) {
      refuse("{}step_s = {} must be 0 (a step per packet) or at least {}", key, chain.step_s,
             kShortest_s);
    }
    const bool rates = chain.probabilities.empty();
    const auto& matrix = rates ? chain.rates_per_s : chain.probabilities;
    const std::string name = key + (rates ? "rates_per_s" : "probabilities");
    if (matrix.size() != n) {
      refuse("{} needs {} rows, as many as {}prr has entries, not {}", name, n, key, matrix.size());
    }
    for (std::size_t i = 0; i < n; ++i) check_row(name, matrix[i], i, rates);
  }

  void check_row(const std::string& name, const std::vector<double>& row, std::size_t i,
                 bool rates) const {
    const std::size_t n = link_.chain.prr.size();
    if (row.size() != n) {
      refuse("{}: row {} needs {} entries, not {}", name, i + 1, n, row.size());
    }
    const double sum = std::accumulate(row.begin(), row.end(), 0.0);
    if (!rates) {
      if (std::abs(sum - 1.0) <= kRounding) return;
      refuse("{}: row {} must sum to 1, not {}", name, i + 1, sum);
    }
    double largest = 0.0, out = 0.0;
    for (std::size_t j = 0; j < n; ++j) {
      largest = std::max(largest, std::abs(row[j]));
      out += j == i ? 0.0 : row[j];
      if (j == i || row[j] >= 0.0) continue;
      refuse("{}: row {}, column {}: {} must not be negative", name, i + 1, j + 1, row[j]);
    }
    if (row[i] != 0.0 && std::abs(sum) > kRounding * largest) {
      refuse("{}: row {}: the diagonal, {}, must be 0 or minus the sum of the row's other entries",
             name, i + 1, row[i]);
    }
    if (out * kShortest_s > 1.0 + kRounding) {
      refuse(
          "{}: row {}: the rates sum to {} per s, but the mean stay in a state must be at least "
          "{} s",
          name, i + 1, out, kShortest_s);
    }
  }

  void check_outages() const {
    double free_from = -std::numeric_limits<double>::infinity();
    for (const auto& outage : link_.outages) {
      if (outage.size() != 2 || !(outage[0] < outage[1]) || outage[0] < free_from) {
        refuse("{}outages must be [[t1, t2], ...] with t1 < t2 <= the next t1", prefix_);
      }
      free_from = outage[1];
    }
  }

  void check_jitter() const {
    const JitterConfig& jitter = link_.jitter;
    const std::string key = prefix_ + "jitter.";
    if (jitter.law == Law::none || jitter.law == Law::constant) return;
    if (jitter.law == Law::table) {
      if (jitter.table_ms.empty() == jitter.file.empty()) {
        refuse("{0}law = \"table\" needs one of {0}table_ms and {0}file", key);
      }
      const auto& table = jitter.table_ms;
      if (table.size() == 1 || !std::is_sorted(table.begin(), table.end())) {
        refuse("{}table_ms must have two or more entries, none below the one before", key);
      }
      return;
    }
    if (jitter.sd_ms <= 0.0) {
      refuse("{0}law = \"{1}\" needs {0}sd_ms > 0", key, name_of(jitter.law));
    }
    if (jitter.law == Law::gamma &&
        (jitter.mean_ms < 0.1 * jitter.sd_ms || jitter.mean_ms > 1e3 * jitter.sd_ms)) {
      refuse("{0}law = \"gamma\" needs {0}mean_ms in [sd_ms/10, 1000 sd_ms]; they are {1} and {2}",
             key, jitter.mean_ms, jitter.sd_ms);
    }
  }

  const std::string prefix_;
  const LinkConfig& link_;
  const std::string& source_;
};

void check_shared_state(const ChannelSettings& channel, const std::string& source) {
  const LinkConfig &uplink = channel.uplink, &downlink = channel.downlink;
  if (!channel.shared_state) return;
  if (uplink.model != downlink.model) {
    throw UsageError(fmt::format(
        "{}: channel.shared_state = true needs the same model for uplink and downlink", source));
  }
  if (uplink.model == Model::markov &&
      (uplink.mean_good_s != downlink.mean_good_s || uplink.mean_bad_s != downlink.mean_bad_s)) {
    throw UsageError(fmt::format(
        "{}: channel.shared_state = true needs the same sojourn times for uplink and downlink "
        "(set channel.markov.… for both)",
        source));
  }
  const ChainConfig &up = uplink.chain, &down = downlink.chain;
  if (uplink.model == Model::chain &&
      (up.rates_per_s != down.rates_per_s || up.probabilities != down.probabilities ||
       up.step_s != down.step_s)) {
    throw UsageError(fmt::format(
        "{}: channel.shared_state = true needs the same matrix for uplink and downlink", source));
  }
  if ((uplink.model == Model::trace && uplink.trace != downlink.trace) ||
      (uplink.model == Model::map && uplink.map != downlink.map)) {
    throw UsageError(
        fmt::format("{0}: channel.shared_state = true needs the same {1} for uplink and downlink "
                    "(set channel.{1}.… for both)",
                    source, uplink.model_name()));
  }
  const bool per_packet =
      uplink.model == Model::gilbert_elliott || uplink.model == Model::four_state ||
      (uplink.model == Model::chain && !up.probabilities.empty() && up.step_s == 0.0);
  if (per_packet) {
    throw UsageError(fmt::format(
        "{}: channel.shared_state = true needs a model that moves in time: \"{}\" moves with each "
        "link's own packets",
        source, uplink.model_name()));
  }
}

}  // namespace

std::string LinkConfig::model_name() const { return kModelNames[static_cast<std::size_t>(model)]; }

std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  std::string model_is = fmt::format("{}model is \"{}\"", prefix, link.model_name());
  if (part == "prr" && link.model != Model::fixed) return model_is;
  if (part == "delay_ms" && link.model != Model::fixed && link.model != Model::gilbert_elliott &&
      link.model != Model::four_state) {
    return model_is;
  }
  for (const Model model : {Model::markov, Model::gilbert_elliott, Model::four_state, Model::chain,
                            Model::trace, Model::map}) {
    if (is_model_part(part, model) && model != link.model) return model_is;
  }
  return why_stage_is_off(prefix, link, part);
}

void resolve_link(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  resolve_sojourn_times(prefix, link, level);
  resolve_burst(prefix, link, level);
}

std::string why_no_link_name(const std::string& name, const ChannelSettings& channel) {
  if (!is_identifier(name)) return "must be letters, digits, '-' and '_', at most 32";
  const auto upper = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    return text;
  };
  const std::string report = upper(name);
  for (const char* taken : {"UPLINK", "DOWNLINK", "COUNTERS", "SET", "SETTINGS"}) {
    if (report == taken) return fmt::format("channel NET/{} has another meaning", taken);
  }
  for (const auto& [other, unused] : channel.links) {
    if (other == name || upper(other) != report) continue;
    return fmt::format("differs from \"{}\" only in case: both would report on NET/{}", other,
                       report);
  }
  return "";
}

void check_channel(const ChannelSettings& channel, const std::string& source) {
  channel.for_each_link([&source](const std::string& name, const LinkConfig& link) {
    LinkChecker("channel." + name + ".", link, source).check();
  });
  check_shared_state(channel, source);
}

}  // namespace tether
