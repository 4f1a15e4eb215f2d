#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace tether {

/// Sockets of a checked udpm URL, for the caller to close: one connected to the group, so that its
/// own address is settled; and one that hears the group, as any number of programs may on one port.
/// Both throw std::runtime_error if the system refuses one.
int open_udpm_sender(const std::string& url);
int open_udpm_receiver(const std::string& url);

/// This process's UDP sockets (IPv4) bound to `port`, ascending: LCM does not hand out its own.
std::vector<int> udp_sockets(std::uint16_t port);

/// Datagrams that the kernel has dropped so far on these sockets, because their buffers were full.
std::int64_t dropped_datagrams(const std::vector<int>& sockets);

}  // namespace tether
