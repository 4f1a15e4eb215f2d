#pragma once

#include <cstdint>
#include <vector>

namespace tether {

/// This process's UDP sockets (IPv4) bound to `port`, ascending: LCM does not hand out its own.
std::vector<int> udp_sockets(std::uint16_t port);

/// Datagrams that the kernel has dropped so far on these sockets, because their buffers were full.
std::int64_t dropped_datagrams(const std::vector<int>& sockets);

}  // namespace tether
