#include "netem/check/tc_export.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>

#include "netem/models/kinds.hpp"

namespace tether {
namespace {

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
  kind_of(link).export_loss(link, sender, out);
  export_copies_and_damage(link, out);
  note_slots_and_outages(link, sender, out);
  return out;
}

}  // namespace tether
