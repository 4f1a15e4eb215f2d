#include "common/scenario/channel_keys.hpp"

namespace tether {
namespace {

constexpr Range kDelay{0.0, 1e6, false};    // ms
constexpr Range kSigned{-1e6, 1e6, false};  // ms

// Keys of the link itself come before those of its parts: that is the order of TOML's sections.
void add_link_itself(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  using Model = LinkConfig::Model;
  t.choice<Model>(prefix + "model", TETHER_LINK(model),
                  {{"fixed", Model::fixed},
                   {"markov", Model::markov},
                   {"gilbert_elliott", Model::gilbert_elliott},
                   {"four_state", Model::four_state},
                   {"chain", Model::chain},
                   {"trace", Model::trace},
                   {"map", Model::map}},
                  "what decides the conditions of the link");
  t.number(prefix + "prr", TETHER_LINK(fixed.prr), kRatio, "model = fixed: packet reception ratio");
  t.number(prefix + "delay_ms", TETHER_LINK(fixed.delay_ms), kDelay,
           "model = fixed, gilbert_elliott, four_state: delay");
  t.whole_number(prefix + "queue_limit", TETHER_LINK(queue_limit), 1,
                 "packets under way; more are dropped and counted");
  t.whole_number(prefix + "queue_limit_bytes", TETHER_LINK(queue_limit_bytes), 1,
                 "the same in bytes of payload");
  t.rows(prefix + "outages", TETHER_LINK(outages), {-1e6, 1e9, false},
         "[[t1, t2], ...]: no packet enters at t1 <= t < t2, seconds since the run's start");
  t.number(prefix + "loss", TETHER_LINK(loss), kRatio,
           "probability that a packet which the model let through is lost, independently");
  t.boolean(prefix + "in_order", TETHER_LINK(in_order),
            "no packet overtakes another: it waits until those before it have left");
}

void add_models(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  t.number(prefix + "markov.good.prr", TETHER_LINK(good.prr), kRatio, "in the good state");
  t.number(prefix + "markov.good.delay_ms", TETHER_LINK(good.delay_ms), kDelay,
           "in the good state");
  t.number(prefix + "markov.bad.prr", TETHER_LINK(bad.prr), kRatio, "in the bad state");
  t.number(prefix + "markov.bad.delay_ms", TETHER_LINK(bad.delay_ms), kDelay, "in the bad state");
  t.number(prefix + "markov.mean_good_s", TETHER_LINK(mean_good_s), kSojourn,
           "mean sojourn time in the good state");
  t.number(prefix + "markov.mean_bad_s", TETHER_LINK(mean_bad_s), kSojourn,
           "mean sojourn time in the bad state");
  t.optional_number(prefix + "markov.p_bad", TETHER_LINK(p_bad), {1e-6, 1.0 - 1e-6, false},
                    "instead of the sojourn times: stationary probability of the bad state ...");
  t.optional_number(prefix + "markov.mean_cycle_s", TETHER_LINK(mean_cycle_s), kSojourn,
                    "... and mean time from one bad spell to the next");

  const std::string ge = prefix + "gilbert_elliott.";
  t.optional_number(ge + "p", TETHER_LINK(gilbert_elliott.p), kRatio, "good to bad, per packet");
  t.optional_number(ge + "r", TETHER_LINK(gilbert_elliott.r), kRatio, "bad to good, per packet");
  t.number(ge + "one_minus_h", TETHER_LINK(gilbert_elliott.one_minus_h), kRatio,
           "loss probability in the bad state (tc's 1-h)");
  t.number(ge + "one_minus_k", TETHER_LINK(gilbert_elliott.one_minus_k), kRatio,
           "loss probability in the good state (tc's 1-k)");
  t.optional_number(ge + "prr", TETHER_LINK(gilbert_elliott.prr), {0.0, 1.0, true},
                    "instead of the four: packet reception ratio ...");
  t.optional_number(ge + "mean_burst", TETHER_LINK(gilbert_elliott.mean_burst), {1.0, 1e9, false},
                    "... and mean length of loss bursts, packets; >= max(1, (1-prr)/prr)");

  const std::string four = prefix + "four_state.";
  t.optional_number(four + "p13", TETHER_LINK(four_state.p13), kRatio, "gap to burst loss");
  t.optional_number(four + "p31", TETHER_LINK(four_state.p31), kRatio,
                    "burst loss to gap; 1 - p13 if not given");
  t.number(four + "p32", TETHER_LINK(four_state.p32), kRatio, "burst loss to received in burst");
  t.number(four + "p23", TETHER_LINK(four_state.p23), kRatio, "received in burst to burst loss");
  t.number(four + "p14", TETHER_LINK(four_state.p14), kRatio, "gap to isolated loss");

  const std::string chain = prefix + "chain.";
  t.list(chain + "prr", TETHER_LINK(chain.prr), kRatio, "packet reception ratio of each state");
  t.list(chain + "delay_ms", TETHER_LINK(chain.delay_ms), kDelay, "delay in each state");
  t.rows(chain + "rates_per_s", TETHER_LINK(chain.rates_per_s), {-1e3, 1e3, false},
         "rates from row to column, at most 1000 out of a state; or ...");
  t.rows(chain + "probabilities", TETHER_LINK(chain.probabilities), kRatio,
         "... probabilities of a step from row to column");
  t.number(chain + "step_s", TETHER_LINK(chain.step_s), {0.0, 1e6, false},
           "probabilities: time between steps, at least 0.001; 0 = one per packet");
}

void add_jitter(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  using Law = JitterConfig::Law;
  t.choice<Law>(prefix + "jitter.law", TETHER_LINK(jitter.law),
                {{"none", Law::none},
                 {"constant", Law::constant},
                 {"uniform", Law::uniform},
                 {"normal", Law::normal},
                 {"pareto", Law::pareto},
                 {"paretonormal", Law::paretonormal},
                 {"gamma", Law::gamma},
                 {"table", Law::table}},
                "of the delay added to the model's; the sum is never negative");
  t.number(prefix + "jitter.mean_ms", TETHER_LINK(jitter.mean_ms), kSigned, "mean of the law");
  t.number(prefix + "jitter.sd_ms", TETHER_LINK(jitter.sd_ms), kDelay,
           "standard deviation of the law");
  t.number(prefix + "jitter.shape", TETHER_LINK(jitter.shape), {2.0, 1e3, true},
           "pareto, paretonormal: tail index");
  t.list(prefix + "jitter.table_ms", TETHER_LINK(jitter.table_ms), kSigned,
         "table: quantiles at equally spaced probabilities from 0 to 1, or ...");
  t.text(prefix + "jitter.file", TETHER_LINK(jitter.file),
         "... a file of observed delays in ms, one a line, relative to the scenario file");
  t.number(prefix + "jitter.correlation", TETHER_LINK(jitter.correlation), {-0.9999, 0.9999, false},
           "of successive packets' normal scores");
}

void add_stages(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  t.number(prefix + "corrupt.probability", TETHER_LINK(corrupt.probability), kRatio,
           "that a packet is damaged");
  t.whole_number(prefix + "corrupt.bits", TETHER_LINK(corrupt.bits), 1,
                 "flipped in a damaged packet");
  t.number(prefix + "duplicate.probability", TETHER_LINK(duplicate_probability), kRatio,
           "that a packet is sent twice");
  t.number(prefix + "rate.bits_per_s", TETHER_LINK(rate.bits_per_s), {0.0, 1e12, false},
           "of the bottleneck; 0 = no limit");
  t.whole_number(prefix + "rate.queue_packets", TETHER_LINK(rate.queue_packets), 1,
                 "waiting for the bottleneck or passing it; more are dropped");
  t.whole_number(prefix + "rate.queue_bytes", TETHER_LINK(rate.queue_bytes), 0,
                 "the same in bytes; 0 = no limit");
  t.whole_number(prefix + "rate.overhead_bytes", TETHER_LINK(rate.overhead_bytes), 0,
                 "added to each packet's length");
  add_jitter(t, prefix, link);
  t.number(prefix + "reorder.probability", TETHER_LINK(reorder.probability), kRatio,
           "that a packet skips its delay");
  t.whole_number(prefix + "reorder.gap", TETHER_LINK(reorder.gap), 1,
                 "at most one packet in so many skips its delay");
  t.number(prefix + "slot.period_ms", TETHER_LINK(slot.period_ms), kDelay,
           "packets are released at multiples of this; 0 = at any time");
  t.number(prefix + "slot.jitter_ms", TETHER_LINK(slot.jitter_ms), kDelay,
           "each slot begins later by up to this; at most the period");
  t.whole_number(prefix + "slot.packets", TETHER_LINK(slot.packets), 0,
                 "released per slot at most; 0 = no limit");
}

}  // namespace

void add_channel_keys(KeyTable& t) {
  t.boolean("channel.shared_state", TETHER_FIELD(channel.shared_state),
            "both directions follow the uplink's state process");
  add_link_keys(t, "channel.uplink.", {LinkSelect::Which::uplink, ""});
  add_link_keys(t, "channel.downlink.", {LinkSelect::Which::downlink, ""});
}

void add_link_keys(KeyTable& t, const std::string& prefix, const LinkSelect& link) {
  add_link_itself(t, prefix, link);
  add_models(t, prefix, link);
  add_trace_and_map_keys(t, prefix, link);
  add_stages(t, prefix, link);
}

}  // namespace tether
