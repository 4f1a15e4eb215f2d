#include "common/lcm/own_addresses.hpp"

#include <ifaddrs.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "common/base/rtnetlink.hpp"

namespace tether {

OwnAddresses::OwnAddresses()
    : fd_(open_rtnetlink(RTMGRP_LINK | RTMGRP_IPV4_IFADDR | RTMGRP_IPV4_ROUTE, SOCK_NONBLOCK)) {
  read();
}

OwnAddresses::~OwnAddresses() { close(fd_); }

bool OwnAddresses::refresh() {
  std::array<char, 16384> news{};
  bool changed = false;
  // ENOBUFS: more has changed than there was room for.
  while (recv(fd_, news.data(), news.size(), 0) > 0 || errno == ENOBUFS) changed = true;
  if (changed) read();
  return changed;
}

void OwnAddresses::read() {
  addresses_ = {htonl(INADDR_ANY)};
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return;
  for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next) {
    if (one->ifa_addr == nullptr || one->ifa_addr->sa_family != AF_INET) continue;
    addresses_.push_back(reinterpret_cast<const sockaddr_in*>(one->ifa_addr)->sin_addr.s_addr);
  }
  freeifaddrs(all);
}

bool OwnAddresses::contains(in_addr address) const {
  return std::find(addresses_.begin(), addresses_.end(), address.s_addr) != addresses_.end();
}

}  // namespace tether
