#include "netem/channel/stages.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>

#include "netem/link/jitter_laws.hpp"

namespace tether {
namespace {

using Table = KeyTable<LinkConfig>;

constexpr Range kSigned{-1e6, 1e6, false};  // ms

/// Keys that begin with `table` but for the switch itself, where that is 0.
std::string why_off(const std::string& prefix, double value, const std::string& switch_key,
                    const std::string& part) {
  const std::string table = switch_key.substr(0, switch_key.find('.') + 1);
  if (value != 0.0 || part == switch_key || !part.starts_with(table)) return "";
  return fmt::format("{}{} is 0", prefix, switch_key);
}

LinkStageKind room() {
  LinkStageKind kind;
  kind.link_keys = [](Table& t) {
    t.whole_number("queue_limit", &LinkConfig::queue_limit, 1,
                   "packets under way; more are dropped and counted");
    t.whole_number("queue_limit_bytes", &LinkConfig::queue_limit_bytes, 1,
                   "the same in bytes of payload");
  };
  kind.switch_key = "queue_limit_bytes";
  return kind;
}

LinkStageKind outages() {
  LinkStageKind kind;
  kind.link_keys = [](Table& t) {
    t.rows("outages", &LinkConfig::outages, {-1e6, 1e9, false},
           "[[t1, t2], ...]: no packet enters at t1 <= t < t2, seconds since the run's start");
  };
  kind.check = [](const LoadedLink& loaded) {
    double free_from = -std::numeric_limits<double>::infinity();
    for (const auto& outage : loaded.link.outages) {
      if (outage.size() != 2 || !(outage[0] < outage[1]) || outage[0] < free_from) {
        loaded.refuse("{}outages must be [[t1, t2], ...] with t1 < t2 <= the next t1",
                      loaded.prefix);
      }
      free_from = outage[1];
    }
  };
  return kind;
}

LinkStageKind loss() {
  LinkStageKind kind;
  kind.link_keys = [](Table& t) {
    t.number("loss", &LinkConfig::loss, kRatio,
             "probability that a packet which the model let through is lost, independently");
  };
  kind.switch_key = "loss";
  return kind;
}

LinkStageKind order() {
  LinkStageKind kind;
  kind.link_keys = [](Table& t) {
    t.boolean("in_order", &LinkConfig::in_order,
              "no packet overtakes another: it waits until those before it have left");
  };
  kind.switch_key = "in_order";
  return kind;
}

LinkStageKind corruption() {
  LinkStageKind kind;
  kind.keys = [](Table& t) {
    t.number("corrupt.probability", TETHER_MEMBER(corrupt.probability), kRatio,
             "that a packet is damaged");
    t.whole_number("corrupt.bits", TETHER_MEMBER(corrupt.bits), 1, "flipped in a damaged packet");
  };
  kind.switch_key = "corrupt.probability";
  kind.why_no_effect = [](const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
    return why_off(prefix, link.corrupt.probability, "corrupt.probability", part);
  };
  return kind;
}

LinkStageKind duplication() {
  LinkStageKind kind;
  kind.keys = [](Table& t) {
    t.number("duplicate.probability", &LinkConfig::duplicate_probability, kRatio,
             "that a packet is sent twice");
  };
  kind.switch_key = "duplicate.probability";
  return kind;
}

LinkStageKind rate() {
  LinkStageKind kind;
  kind.keys = [](Table& t) {
    t.number("rate.bits_per_s", TETHER_MEMBER(rate.bits_per_s), {0.0, 1e12, false},
             "of the bottleneck; 0 = no limit");
    t.whole_number("rate.queue_packets", TETHER_MEMBER(rate.queue_packets), 1,
                   "waiting for the bottleneck or passing it; more are dropped");
    t.whole_number("rate.queue_bytes", TETHER_MEMBER(rate.queue_bytes), 0,
                   "the same in bytes; 0 = no limit");
    t.whole_number("rate.overhead_bytes", TETHER_MEMBER(rate.overhead_bytes), 0,
                   "added to each packet's length");
  };
  kind.switch_key = "rate.bits_per_s";
  kind.why_no_effect = [](const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
    return why_off(prefix, link.rate.bits_per_s, "rate.bits_per_s", part);
  };
  return kind;
}

void add_jitter_keys(Table& t) {
  using Law = JitterConfig::Law;
  Names<Law> laws;
  for (const JitterLaw& row : jitter_laws()) laws.emplace_back(row.name, row.law);
  t.choice<Law>("jitter.law", TETHER_MEMBER(jitter.law), laws,
                "of the delay added to the model's; the sum is never negative");
  t.number("jitter.mean_ms", TETHER_MEMBER(jitter.mean_ms), kSigned, "mean of the law");
  t.number("jitter.sd_ms", TETHER_MEMBER(jitter.sd_ms), kDelayRange_ms,
           "standard deviation of the law");
  t.number("jitter.shape", TETHER_MEMBER(jitter.shape), {2.0, 1e3, true},
           "pareto, paretonormal: tail index");
  t.list("jitter.table_ms", TETHER_MEMBER(jitter.table_ms), kSigned,
         "table: quantiles at equally spaced probabilities from 0 to 1, or ...");
  t.file("jitter.file", TETHER_MEMBER(jitter.file),
         "... a file of observed delays in ms, one a line, relative to the scenario file");
  t.number("jitter.correlation", TETHER_MEMBER(jitter.correlation), {-0.9999, 0.9999, false},
           "of successive packets' normal scores");
}

void check_jitter(const LoadedLink& loaded) {
  using Law = JitterConfig::Law;
  const JitterConfig& jitter = loaded.link.jitter;
  const JitterLaw& law = jitter_law(jitter.law);
  const std::string key = loaded.prefix + "jitter.";
  if (jitter.law == Law::table) {
    if (jitter.table_ms.empty() == jitter.file.empty()) {
      loaded.refuse("{0}law = \"table\" needs one of {0}table_ms and {0}file", key);
    }
    const auto& table = jitter.table_ms;
    if (table.size() == 1 || !std::is_sorted(table.begin(), table.end())) {
      loaded.refuse("{}table_ms must have two or more entries, none below the one before", key);
    }
  }
  if (law.uses("sd_ms") && jitter.sd_ms <= 0.0) {
    loaded.refuse("{0}law = \"{1}\" needs {0}sd_ms > 0", key, law.name);
  }
  if (jitter.law == Law::gamma &&
      (jitter.mean_ms < 0.1 * jitter.sd_ms || jitter.mean_ms > 1e3 * jitter.sd_ms)) {
    loaded.refuse(
        "{0}law = \"gamma\" needs {0}mean_ms in [sd_ms/10, 1000 sd_ms]; they are {1} and {2}", key,
        jitter.mean_ms, jitter.sd_ms);
  }
}

LinkStageKind jitter() {
  LinkStageKind kind;
  kind.keys = add_jitter_keys;
  kind.switch_key = "jitter.law";
  kind.why_no_effect = [](const std::string& prefix, const LinkConfig& link,
                          const std::string& part) -> std::string {
    const JitterLaw& law = jitter_law(link.jitter.law);
    if (!part.starts_with("jitter.") || part == "jitter.law" || law.uses(part.substr(7))) return "";
    return fmt::format("{}jitter.law is \"{}\"", prefix, law.name);
  };
  kind.check = check_jitter;
  return kind;
}

LinkStageKind reordering() {
  LinkStageKind kind;
  kind.keys = [](Table& t) {
    t.number("reorder.probability", TETHER_MEMBER(reorder.probability), kRatio,
             "that a packet skips its delay");
    t.whole_number("reorder.gap", TETHER_MEMBER(reorder.gap), 1,
                   "at most one packet in so many skips its delay");
  };
  kind.switch_key = "reorder.probability";
  kind.why_no_effect = [](const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
    return why_off(prefix, link.reorder.probability, "reorder.probability", part);
  };
  kind.check = [](const LoadedLink& loaded) {
    const double probability = loaded.link.reorder.probability;
    if (!loaded.link.in_order || probability <= 0.0) return;
    loaded.refuse("{0}in_order = true and {0}reorder.probability = {1} contradict each other",
                  loaded.prefix, probability);
  };
  return kind;
}

LinkStageKind slots() {
  LinkStageKind kind;
  kind.keys = [](Table& t) {
    t.number("slot.period_ms", TETHER_MEMBER(slot.period_ms), kDelayRange_ms,
             "packets are released at multiples of this; 0 = at any time");
    t.number("slot.jitter_ms", TETHER_MEMBER(slot.jitter_ms), kDelayRange_ms,
             "each slot begins later by up to this; at most the period");
    t.whole_number("slot.packets", TETHER_MEMBER(slot.packets), 0,
                   "released per slot at most; 0 = no limit");
  };
  kind.switch_key = "slot.period_ms";
  kind.why_no_effect = [](const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
    return why_off(prefix, link.slot.period_ms, "slot.period_ms", part);
  };
  kind.check = [](const LoadedLink& loaded) {
    const SlotConfig& slot = loaded.link.slot;
    if (slot.jitter_ms <= slot.period_ms) return;
    loaded.refuse("{0}slot.jitter_ms = {1} must not be above {0}slot.period_ms = {2}",
                  loaded.prefix, slot.jitter_ms, slot.period_ms);
  };
  return kind;
}

}  // namespace

const std::vector<LinkStageKind>& link_stage_kinds() {
  static const std::vector<LinkStageKind> kinds{room(),       outages(),     loss(), order(),
                                                corruption(), duplication(), rate(), jitter(),
                                                reordering(), slots()};
  return kinds;
}

}  // namespace tether
