#pragma once

#include <string>

#include "netem/link/link_config.hpp"
#include "netem/link/tc.hpp"

namespace tether {

/// `link` is as scenario loading leaves it.
TcExport export_tc(const LinkConfig& link, const TcSender& sender);

// Parts of export_tc(), which append to an export under way.

/// `delay`, `reorder` and `rate`: everything that decides when a packet leaves.
void export_tc_timing(const LinkConfig& link, const TcSender& sender, TcExport& out);

/// Bytes of an Ethernet frame with a short LCM message (one fragment, over UDP and IPv4) that are
/// not the message's own.
double frame_overhead_bytes(const std::string& channel);

}  // namespace tether
