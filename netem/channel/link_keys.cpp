#include "netem/channel/link_keys.hpp"

#include "netem/link/jitter_laws.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

constexpr Range kSigned{-1e6, 1e6, false};  // ms

// Keys of the link itself come before those of its parts: that is the order of TOML's sections.
void add_link_itself(KeyTable<LinkConfig>& t) {
  std::vector<std::string> models;
  for (const ChannelModelKind& kind : channel_model_kinds()) models.push_back(kind.name);
  t.one_of("model", &LinkConfig::model, models, "what decides the conditions of the link");
  t.number("prr", TETHER_MEMBER(fixed.prr), kRatio, "model = fixed: packet reception ratio");
  t.number("delay_ms", TETHER_MEMBER(fixed.delay_ms), kDelayRange_ms,
           "model = fixed, gilbert_elliott, four_state: delay");
  t.whole_number("queue_limit", &LinkConfig::queue_limit, 1,
                 "packets under way; more are dropped and counted");
  t.whole_number("queue_limit_bytes", &LinkConfig::queue_limit_bytes, 1,
                 "the same in bytes of payload");
  t.rows("outages", &LinkConfig::outages, {-1e6, 1e9, false},
         "[[t1, t2], ...]: no packet enters at t1 <= t < t2, seconds since the run's start");
  t.number("loss", &LinkConfig::loss, kRatio,
           "probability that a packet which the model let through is lost, independently");
  t.boolean("in_order", &LinkConfig::in_order,
            "no packet overtakes another: it waits until those before it have left");
}

void add_jitter(KeyTable<LinkConfig>& t) {
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

void add_stages(KeyTable<LinkConfig>& t) {
  t.number("corrupt.probability", TETHER_MEMBER(corrupt.probability), kRatio,
           "that a packet is damaged");
  t.whole_number("corrupt.bits", TETHER_MEMBER(corrupt.bits), 1, "flipped in a damaged packet");
  t.number("duplicate.probability", &LinkConfig::duplicate_probability, kRatio,
           "that a packet is sent twice");
  t.number("rate.bits_per_s", TETHER_MEMBER(rate.bits_per_s), {0.0, 1e12, false},
           "of the bottleneck; 0 = no limit");
  t.whole_number("rate.queue_packets", TETHER_MEMBER(rate.queue_packets), 1,
                 "waiting for the bottleneck or passing it; more are dropped");
  t.whole_number("rate.queue_bytes", TETHER_MEMBER(rate.queue_bytes), 0,
                 "the same in bytes; 0 = no limit");
  t.whole_number("rate.overhead_bytes", TETHER_MEMBER(rate.overhead_bytes), 0,
                 "added to each packet's length");
  add_jitter(t);
  t.number("reorder.probability", TETHER_MEMBER(reorder.probability), kRatio,
           "that a packet skips its delay");
  t.whole_number("reorder.gap", TETHER_MEMBER(reorder.gap), 1,
                 "at most one packet in so many skips its delay");
  t.number("slot.period_ms", TETHER_MEMBER(slot.period_ms), kDelayRange_ms,
           "packets are released at multiples of this; 0 = at any time");
  t.number("slot.jitter_ms", TETHER_MEMBER(slot.jitter_ms), kDelayRange_ms,
           "each slot begins later by up to this; at most the period");
  t.whole_number("slot.packets", TETHER_MEMBER(slot.packets), 0,
                 "released per slot at most; 0 = no limit");
}

}  // namespace

std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link) {
  KeyTable<LinkConfig> t(prefix, link);
  add_link_itself(t);
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.keys != nullptr) t.append(kind.keys({prefix, link}));
  }
  add_stages(t);
  return t.take();
}

}  // namespace tether
