#include "netem/models/link_keys.hpp"

namespace tether {
namespace {

constexpr Range kSojourn{1e-3, 1e9, false};
constexpr Range kDelay{0.0, 1e6, false};    // ms
constexpr Range kSigned{-1e6, 1e6, false};  // ms

// Keys of the link itself come before those of its parts: that is the order of TOML's sections.
void add_link_itself(KeyTable<LinkConfig>& t) {
  using Model = LinkConfig::Model;
  t.choice<Model>("model", &LinkConfig::model,
                  {{"fixed", Model::fixed},
                   {"markov", Model::markov},
                   {"gilbert_elliott", Model::gilbert_elliott},
                   {"four_state", Model::four_state},
                   {"chain", Model::chain},
                   {"trace", Model::trace},
                   {"map", Model::map}},
                  "what decides the conditions of the link");
  t.number("prr", TETHER_MEMBER(fixed.prr), kRatio, "model = fixed: packet reception ratio");
  t.number("delay_ms", TETHER_MEMBER(fixed.delay_ms), kDelay,
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

void add_models(KeyTable<LinkConfig>& t) {
  t.number("markov.good.prr", TETHER_MEMBER(good.prr), kRatio, "in the good state");
  t.number("markov.good.delay_ms", TETHER_MEMBER(good.delay_ms), kDelay, "in the good state");
  t.number("markov.bad.prr", TETHER_MEMBER(bad.prr), kRatio, "in the bad state");
  t.number("markov.bad.delay_ms", TETHER_MEMBER(bad.delay_ms), kDelay, "in the bad state");
  t.number("markov.mean_good_s", &LinkConfig::mean_good_s, kSojourn,
           "mean sojourn time in the good state");
  t.number("markov.mean_bad_s", &LinkConfig::mean_bad_s, kSojourn,
           "mean sojourn time in the bad state");
  t.optional_number("markov.p_bad", &LinkConfig::p_bad, {1e-6, 1.0 - 1e-6, false},
                    "instead of the sojourn times: stationary probability of the bad state ...");
  t.optional_number("markov.mean_cycle_s", &LinkConfig::mean_cycle_s, kSojourn,
                    "... and mean time from one bad spell to the next");

  t.optional_number("gilbert_elliott.p", TETHER_MEMBER(gilbert_elliott.p), kRatio,
                    "good to bad, per packet");
  t.optional_number("gilbert_elliott.r", TETHER_MEMBER(gilbert_elliott.r), kRatio,
                    "bad to good, per packet");
  t.number("gilbert_elliott.one_minus_h", TETHER_MEMBER(gilbert_elliott.one_minus_h), kRatio,
           "loss probability in the bad state (tc's 1-h)");
  t.number("gilbert_elliott.one_minus_k", TETHER_MEMBER(gilbert_elliott.one_minus_k), kRatio,
           "loss probability in the good state (tc's 1-k)");
  t.optional_number("gilbert_elliott.prr", TETHER_MEMBER(gilbert_elliott.prr), {0.0, 1.0, true},
                    "instead of the four: packet reception ratio ...");
  t.optional_number("gilbert_elliott.mean_burst", TETHER_MEMBER(gilbert_elliott.mean_burst),
                    {1.0, 1e9, false},
                    "... and mean length of loss bursts, packets; >= max(1, (1-prr)/prr)");

  t.optional_number("four_state.p13", TETHER_MEMBER(four_state.p13), kRatio, "gap to burst loss");
  t.optional_number("four_state.p31", TETHER_MEMBER(four_state.p31), kRatio,
                    "burst loss to gap; 1 - p13 if not given");
  t.number("four_state.p32", TETHER_MEMBER(four_state.p32), kRatio,
           "burst loss to received in burst");
  t.number("four_state.p23", TETHER_MEMBER(four_state.p23), kRatio,
           "received in burst to burst loss");
  t.number("four_state.p14", TETHER_MEMBER(four_state.p14), kRatio, "gap to isolated loss");

  t.list("chain.prr", TETHER_MEMBER(chain.prr), kRatio, "packet reception ratio of each state");
  t.list("chain.delay_ms", TETHER_MEMBER(chain.delay_ms), kDelay, "delay in each state");
  t.rows("chain.rates_per_s", TETHER_MEMBER(chain.rates_per_s), {-1e3, 1e3, false},
         "rates from row to column, at most 1000 out of a state; or ...");
  t.rows("chain.probabilities", TETHER_MEMBER(chain.probabilities), kRatio,
         "... probabilities of a step from row to column");
  t.number("chain.step_s", TETHER_MEMBER(chain.step_s), {0.0, 1e6, false},
           "probabilities: time between steps, at least 0.001; 0 = one per packet");
}

void add_jitter(KeyTable<LinkConfig>& t) {
  using Law = JitterConfig::Law;
  t.choice<Law>("jitter.law", TETHER_MEMBER(jitter.law),
                {{"none", Law::none},
                 {"constant", Law::constant},
                 {"uniform", Law::uniform},
                 {"normal", Law::normal},
                 {"pareto", Law::pareto},
                 {"paretonormal", Law::paretonormal},
                 {"gamma", Law::gamma},
                 {"table", Law::table}},
                "of the delay added to the model's; the sum is never negative");
  t.number("jitter.mean_ms", TETHER_MEMBER(jitter.mean_ms), kSigned, "mean of the law");
  t.number("jitter.sd_ms", TETHER_MEMBER(jitter.sd_ms), kDelay, "standard deviation of the law");
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
  t.number("slot.period_ms", TETHER_MEMBER(slot.period_ms), kDelay,
           "packets are released at multiples of this; 0 = at any time");
  t.number("slot.jitter_ms", TETHER_MEMBER(slot.jitter_ms), kDelay,
           "each slot begins later by up to this; at most the period");
  t.whole_number("slot.packets", TETHER_MEMBER(slot.packets), 0,
                 "released per slot at most; 0 = no limit");
}

}  // namespace

std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link) {
  KeyTable<LinkConfig> t(prefix, link);
  add_link_itself(t);
  add_models(t);
  add_trace_and_map_keys(t);
  add_stages(t);
  return t.take();
}

}  // namespace tether
