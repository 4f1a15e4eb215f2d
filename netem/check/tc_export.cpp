#include "netem/check/tc_export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace tether {
namespace {

using Model = LinkConfig::Model;

/// Two states that step once a packet: `loss gemodel`.
std::string gemodel(double p, double r, double bad_loss, double good_loss) {
  return fmt::format(" loss gemodel {} {} {} {}", tc_percent(p), tc_percent(r),
                     tc_percent(bad_loss), tc_percent(good_loss));
}

/// Of a packet that passes two losses.
double either(double loss, double other) { return 1.0 - (1.0 - loss) * (1.0 - other); }

void export_markov(const LinkConfig& link, const TcSender& sender, TcExport& out) {
  const double good = link.mean_good_s, bad = link.mean_bad_s;
  const double change = -std::expm1(-sender.interval_s * (1.0 / good + 1.0 / bad));
  const double p_bad = bad / (good + bad);
  out.notes.push_back(fmt::format(
      "model = \"markov\" has no equivalent: netem's states step with packets, not with time; as "
      "long as packets come every {:g} ms, \"{}\" loses them alike",
      sender.interval_s * 1e3,
      gemodel(p_bad * change, (1.0 - p_bad) * change, either(1.0 - link.bad.prr, link.loss),
              either(1.0 - link.good.prr, link.loss))
          .substr(1)));
}

void export_chain(const LinkConfig& link, TcExport& out) {
  const ChainConfig& chain = link.chain;
  const bool per_packet = !chain.probabilities.empty() && chain.step_s == 0.0;
  if (per_packet && chain.prr.size() == 2) {
    out.command +=
        gemodel(chain.probabilities[0][1], chain.probabilities[1][0],
                either(1.0 - chain.prr[1], link.loss), either(1.0 - chain.prr[0], link.loss));
    return;
  }
  out.notes.push_back(per_packet
                          ? "model = \"chain\" has no equivalent: netem has chains of two states "
                            "(gemodel) and that of four (state) only"
                          : "model = \"chain\" has no equivalent: netem's states step with "
                            "packets, not with time");
}

void export_loss(const LinkConfig& link, const TcSender& sender, TcExport& out) {
  switch (link.model) {
    case Model::fixed: {
      const double loss = either(1.0 - link.fixed.prr, link.loss);
      if (loss > 0.0) out.command += " loss random " + tc_percent(loss);
      return;
    }
    case Model::gilbert_elliott: {
      const GilbertElliottConfig& c = link.gilbert_elliott;
      out.command += gemodel(c.p.value(), c.r.value(), either(c.one_minus_h, link.loss),
                             either(c.one_minus_k, link.loss));
      return;
    }
    case Model::four_state: {
      const FourStateConfig& c = link.four_state;
      const double p13 = c.p13.value();
      out.command += fmt::format(" loss state {} {} {} {} {}", tc_percent(p13),
                                 tc_percent(c.p31.value_or(1.0 - p13)), tc_percent(c.p32),
                                 tc_percent(c.p23), tc_percent(c.p14));
      if (link.loss == 0.0) return;
      break;
    }
    case Model::markov:
      return export_markov(link, sender, out);
    case Model::chain:
      return export_chain(link, out);
    case Model::trace:
      out.notes.emplace_back("model = \"trace\" has no equivalent: netem plays no recordings");
      break;
    case Model::map:
      out.notes.emplace_back("model = \"map\" has no equivalent: netem knows no position");
      break;
  }
  if (link.loss == 0.0) return;
  if (link.model != Model::four_state) {
    out.command += " loss random " + tc_percent(link.loss);
  } else {
    out.notes.push_back(fmt::format(
        "loss = {:g} is left out: one netem has one loss model; a second one, as its child, would "
        "have it",
        link.loss));
  }
}

void export_copies_and_damage(const LinkConfig& link, TcExport& out) {
  const bool lossy = out.command.find(" loss ") != std::string::npos;
  if (link.duplicate_probability > 0.0) {
    out.command += " duplicate " + tc_percent(link.duplicate_probability);
    if (lossy) {
      out.notes.emplace_back(
          "duplicate: netem tosses for the copy before the loss, so that one of the two may "
          "survive "
          "where Tether loses the packet, and for the loss of a copy again");
    }
  }
  if (link.corrupt.probability <= 0.0) return;
  out.command += " corrupt " + tc_percent(link.corrupt.probability);
  out.notes.push_back(fmt::format(
      "corrupt: netem flips one bit{} anywhere in the frame, headers included; the receiver's "
      "network stack drops nearly all such packets for their checksum",
      link.corrupt.bits > 1 ? fmt::format(", not {},", link.corrupt.bits) : ""));
}

void note_slots_and_outages(const LinkConfig& link, const TcSender& sender, TcExport& out) {
  if (link.slot.period_ms > 0.0) {
    const SlotConfig& slot = link.slot;
    out.notes.push_back(fmt::format(
        "slot has no equivalent: netem's slots begin a delay after the last one was used, not on a "
        "grid of time; the nearest is \"slot {} {}{}\"",
        tc_time(slot.period_ms), tc_time(slot.period_ms + slot.jitter_ms),
        slot.packets > 0 ? fmt::format(" packets {}", slot.packets) : ""));
  }
  if (!link.outages.empty()) {
    out.notes.push_back(fmt::format(
        "outages have no equivalent: netem knows no schedule; \"tc qdisc change dev {} root netem "
        "loss 100%\" begins one",
        sender.interface));
  }
}

/// tc's limit counts the packets that it holds, delayed ones included: queue_limit.
void export_limit(const LinkConfig& link, TcExport& out) {
  std::int64_t limit = std::min<std::int64_t>(link.queue_limit, UINT32_MAX);
  if (link.rate.bits_per_s > 0.0) {
    // Without delay all packets in it wait for the rate.
    const bool delayed = out.command.find(" delay ") != std::string::npos;
    if (!delayed) limit = std::min(limit, link.rate.queue_packets);
    if (delayed) {
      out.notes.push_back(fmt::format(
          "rate.queue_packets = {} is left out: netem's limit counts delayed packets as well",
          link.rate.queue_packets));
    }
    if (link.rate.queue_bytes > 0) {
      out.notes.push_back(fmt::format(
          "rate.queue_bytes = {} is left out: netem's limit is in packets", link.rate.queue_bytes));
    }
  }
  out.command += fmt::format(" limit {}", limit);
}

}  // namespace

std::string tc_percent(double probability) { return fmt::format("{:.10g}%", 100.0 * probability); }

std::string tc_time(double milliseconds) { return fmt::format("{:.10g}ms", milliseconds); }

double frame_overhead_bytes(const std::string& channel) {
  constexpr double kEthernet = 14.0, kIpv4 = 20.0, kUdp = 8.0;
  constexpr double kLcm = 8.0;  // magic and sequence number, then the channel's name and a zero
  return kEthernet + kIpv4 + kUdp + kLcm + static_cast<double>(channel.size()) + 1.0;
}

TcExport export_tc(const LinkConfig& link, const TcSender& sender) {
  TcExport out;
  out.command = fmt::format("tc qdisc add dev {} root netem", sender.interface);
  export_tc_timing(link, sender, out);
  export_limit(link, out);
  export_loss(link, sender, out);
  export_copies_and_damage(link, out);
  note_slots_and_outages(link, sender, out);
  return out;
}

}  // namespace tether
