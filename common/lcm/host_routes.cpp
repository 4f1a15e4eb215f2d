#include "common/lcm/host_routes.hpp"

#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <system_error>

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

namespace {

/// About the route to one IPv4 address.
RtnetlinkRequest<rtmsg> route_request(std::uint16_t type, std::uint16_t flags,
                                      in_addr destination) {
  RtnetlinkRequest<rtmsg> request(type, flags);
  request.body().rtm_family = AF_INET;
  request.body().rtm_dst_len = 32;
  request.add(RTA_DST, &destination, sizeof destination);
  return request;
}

RtnetlinkAnswer answer_to(const RtnetlinkRequest<rtmsg>& request) {
  const int fd = open_rtnetlink(0, 0);
  RtnetlinkAnswer answer;
  try {
    request.exchange(fd, answer);
  } catch (...) {
    close(fd);
    throw;
  }
  close(fd);
  return answer;
}

RtnetlinkRequest<rtmsg> loopback_request(std::uint16_t type, std::uint16_t flags, in_addr group) {
  auto request = route_request(type, static_cast<std::uint16_t>(flags | NLM_F_ACK), group);
  request.body().rtm_table = RT_TABLE_MAIN;
  request.body().rtm_protocol = RTPROT_STATIC;
  request.body().rtm_scope = RT_SCOPE_LINK;
  request.body().rtm_type = RTN_UNICAST;
  const unsigned loopback = if_nametoindex("lo");
  const in_addr_t sender = htonl(INADDR_LOOPBACK);
  request.add(RTA_OIF, &loopback, sizeof loopback);
  request.add(RTA_PREFSRC, &sender, sizeof sender);
  return request;
}

}  // namespace

std::string outgoing_interface(in_addr destination) {
  const RtnetlinkAnswer answer = answer_to(route_request(RTM_GETROUTE, 0, destination));
  const nlmsghdr* message = answer.first(RTM_NEWROUTE);
  if (message == nullptr) return "";
  const auto* route = static_cast<const rtmsg*>(NLMSG_DATA(message));
  const rtattr* out = find_attribute(RTM_RTA(route), RTM_PAYLOAD(message), RTA_OIF);
  if (out == nullptr) return "";
  unsigned index = 0;
  std::memcpy(&index, RTA_DATA(out), sizeof index);
  std::array<char, IF_NAMESIZE> name{};
  return if_indextoname(index, name.data()) == nullptr ? "" : name.data();
}

void route_over_loopback(in_addr group) {
  const int error =
      answer_to(loopback_request(RTM_NEWROUTE, NLM_F_CREATE | NLM_F_REPLACE, group)).error();
  if (error != 0) throw std::system_error(error, std::generic_category(), "adding a route over lo");
}

void remove_loopback_route(in_addr group) {
  const int error = answer_to(loopback_request(RTM_DELROUTE, 0, group)).error();
  if (error != 0 && error != ESRCH) {
    throw std::system_error(error, std::generic_category(), "removing the route over lo");
  }
}

}  // namespace tether
