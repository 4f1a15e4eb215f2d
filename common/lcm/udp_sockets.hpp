#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <vector>

namespace tether {

/// Sockets of a checked udpm URL, for the caller to close: one to send from, with a port of its
/// own; and one that hears the group, as any number of programs may on one port. Both throw
/// std::runtime_error if the system refuses one.
///
/// The route to the group says over which interface, as in LCM. So the sender is not connected:
/// that would settle its address, which with a route over the loopback interface is another
/// interface's, and multicasts leave by the interface of their address.
int open_udpm_sender(const std::string& url);
int open_udpm_receiver(const std::string& url);

/// The group of a checked udpm URL as where to send to.
sockaddr_in udpm_address(const std::string& url);

/// Whether it is one of this host's addresses, or none (0.0.0.0, as over the loopback interface).
bool is_own_address(in_addr address);

/// This process's UDP sockets (IPv4) bound to `port`, ascending: LCM does not hand out its own.
std::vector<int> udp_sockets(std::uint16_t port);

/// Datagrams that the kernel has dropped so far on these sockets, because their buffers were full.
std::int64_t dropped_datagrams(const std::vector<int>& sockets);

}  // namespace tether
