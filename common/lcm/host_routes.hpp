#pragma once

#include <netinet/in.h>

#include <string>
#include <vector>

namespace tether {

/// This host's IPv4 addresses, as the kernel announces their changes.
class OwnAddresses {
 public:
  /// Throws std::system_error if the kernel announces none here.
  OwnAddresses();
  ~OwnAddresses();
  OwnAddresses(const OwnAddresses&) = delete;
  OwnAddresses& operator=(const OwnAddresses&) = delete;

  /// Readable after an address, an interface or a route of this host has changed: refresh() then.
  int fd() const { return fd_; }
  /// Reads what has changed; false if nothing has.
  bool refresh();
  /// Includes 0.0.0.0, the sender over a loopback interface on a host without another address. The
  /// kernel takes no datagram from outside with an address of this host, or 0.0.0.0, as its sender.
  bool contains(in_addr address) const;

 private:
  void read();

  int fd_ = -1;
  std::vector<in_addr_t> addresses_;
};

/// Name of the interface by which this host would send to an address; empty if there is none.
std::string outgoing_interface(in_addr destination);

/// Routes a multicast group over the loopback interface, with 127.0.0.1 as the sender, or takes
/// that route away again; no error if that is so already. Throws std::system_error, as without the
/// right to change this host's network (CAP_NET_ADMIN).
void route_over_loopback(in_addr group);
void remove_loopback_route(in_addr group);

}  // namespace tether
