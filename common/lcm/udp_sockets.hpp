#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <vector>

namespace tether {

/// Sockets of a checked udpm URL, for the caller to close: one to send from, with a port of its
/// own; and one that hears the group and nothing else, as any number of programs may on one port.
/// Both throw std::runtime_error if the system refuses one.
///
/// The route to the group says over which interface, as in LCM. So the sender is not connected:
/// that would settle its address, which with a route over the loopback interface is another
/// interface's, and multicasts leave by the interface of their address.
int open_udpm_sender(const std::string& url);
int open_udpm_receiver(const std::string& url);

/// Joins the group where the route to it leads now, too; with ttl=0 also on the loopback interface.
/// False if neither is possible.
bool join_udpm_group(int fd, const std::string& url);

/// Whether a network is this host's alone (ttl=0) and its loopback interface is up: then Tether's
/// programs hear each other, whatever routes there are.
bool reachable_over_loopback(const std::string& url);

/// sendmsg(2) to a udpm URL's group. With ttl=0, what cannot leave this host anyway goes over the
/// loopback interface if there is no route, or none any more.
bool send_udpm(int fd, const std::string& url, msghdr& message);

/// The group of a checked udpm URL as where to send to.
sockaddr_in udpm_address(const std::string& url);

/// This process's UDP sockets (IPv4) bound to `port`, ascending: LCM does not hand out its own.
std::vector<int> udp_sockets(std::uint16_t port);

/// Datagrams that the kernel has dropped so far on these sockets, because their buffers were full.
std::int64_t dropped_datagrams(const std::vector<int>& sockets);

}  // namespace tether
