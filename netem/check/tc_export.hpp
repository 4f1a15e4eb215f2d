#pragma once

#include <string>
#include <vector>

#include "netem/link/link_config.hpp"

namespace tether {

/// Who sends what a link impairs.
struct TcSender {
  std::string interface;    ///< of the sender's computer, towards the network
  std::string channel;      ///< LCM channel, whose name is in every packet
  double interval_s = 1.0;  ///< between packets
};

/// A link as tc-netem(8) of iproute2 6.1 and net/sched/sch_netem.c of Linux 6.18 do it.
struct TcExport {
  std::string command;  ///< `tc qdisc add dev … root netem …`, with all that has an equivalent
  /// What the command lacks or does otherwise, and why; one line each.
  std::vector<std::string> notes;
};

/// `link` is as scenario loading leaves it.
TcExport export_tc(const LinkConfig& link, const TcSender& sender);

// Parts of export_tc(), which append to an export under way.

/// `delay`, `reorder` and `rate`: everything that decides when a packet leaves.
void export_tc_timing(const LinkConfig& link, const TcSender& sender, TcExport& out);

/// As tc reads numbers: "12.5%", "0.25ms".
std::string tc_percent(double probability);
std::string tc_time(double milliseconds);

/// Bytes of an Ethernet frame with a short LCM message (one fragment, over UDP and IPv4) that are
/// not the message's own.
double frame_overhead_bytes(const std::string& channel);

}  // namespace tether
