#pragma once

#include <netinet/in.h>

#include <string>

namespace tether {

/// Name of the interface by which this host would send to an address; empty if there is none.
std::string outgoing_interface(in_addr destination);

/// Routes a multicast group over the loopback interface, with 127.0.0.1 as the sender, or takes
/// that route away again; no error if that is so already. Throws std::system_error, as without the
/// right to change this host's network (CAP_NET_ADMIN).
void route_over_loopback(in_addr group);
void remove_loopback_route(in_addr group);

}  // namespace tether
