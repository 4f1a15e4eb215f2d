#include "common/lcm/host_routes.hpp"

#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <system_error>
#include <vector>

#include "common/base/system_error.hpp"

namespace tether {
namespace {

/// A request about the route to one IPv4 address.
class RouteRequest {
 public:
  RouteRequest(std::uint16_t type, std::uint16_t flags, in_addr destination) {
    header_.nlmsg_type = type;
    header_.nlmsg_flags = static_cast<std::uint16_t>(NLM_F_REQUEST | flags);
    route_.rtm_family = AF_INET;
    route_.rtm_dst_len = 32;
    add(RTA_DST, destination);
  }

  rtmsg& route() { return route_; }

  /// `value` has 4 bytes.
  template <class Value>
  void add(std::uint16_t kind, const Value& value) {
    static_assert(sizeof value == 4);
    const rtattr attribute{RTA_LENGTH(sizeof value), kind};
    const auto* head = reinterpret_cast<const char*>(&attribute);
    const auto* body = reinterpret_cast<const char*>(&value);
    attributes_.insert(attributes_.end(), head, head + sizeof attribute);
    attributes_.insert(attributes_.end(), body, body + sizeof value);
  }

  /// The kernel's first answer. It comes before send() returns.
  std::vector<char> answer() {
    std::vector<char> request(NLMSG_SPACE(sizeof route_));
    header_.nlmsg_len = static_cast<std::uint32_t>(request.size() + attributes_.size());
    std::memcpy(request.data(), &header_, sizeof header_);
    std::memcpy(request.data() + NLMSG_HDRLEN, &route_, sizeof route_);
    request.insert(request.end(), attributes_.begin(), attributes_.end());
    const int fd = check_system_call("asking the kernel for a route",
                                     socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
    std::vector<char> heard(8192);
    ssize_t bytes = send(fd, request.data(), request.size(), 0);
    if (bytes >= 0) bytes = recv(fd, heard.data(), heard.size(), MSG_DONTWAIT);
    const int error = errno;
    close(fd);
    if (bytes < 0)
      throw std::system_error(error, std::generic_category(), "asking the kernel for a route");
    heard.resize(static_cast<std::size_t>(bytes));
    return heard;
  }

 private:
  nlmsghdr header_{};
  rtmsg route_{};
  std::vector<char> attributes_;
};

/// Error number of an answer; 0 if it is an acknowledgement.
int error_in(const std::vector<char>& answer) {
  nlmsghdr header{};
  nlmsgerr error{};
  if (answer.size() < NLMSG_HDRLEN + sizeof error) return EPROTO;
  std::memcpy(&header, answer.data(), sizeof header);
  if (header.nlmsg_type != NLMSG_ERROR) return EPROTO;
  std::memcpy(&error, answer.data() + NLMSG_HDRLEN, sizeof error);
  return -error.error;
}

RouteRequest loopback_request(std::uint16_t type, std::uint16_t flags, in_addr group) {
  RouteRequest request(type, static_cast<std::uint16_t>(flags | NLM_F_ACK), group);
  request.route().rtm_table = RT_TABLE_MAIN;
  request.route().rtm_protocol = RTPROT_STATIC;
  request.route().rtm_scope = RT_SCOPE_LINK;
  request.route().rtm_type = RTN_UNICAST;
  request.add(RTA_OIF, if_nametoindex("lo"));
  request.add(RTA_PREFSRC, htonl(INADDR_LOOPBACK));
  return request;
}

}  // namespace

std::string outgoing_interface(in_addr destination) {
  std::vector<char> answer = RouteRequest(RTM_GETROUTE, 0, destination).answer();
  auto left = static_cast<int>(answer.size());
  const auto* header = reinterpret_cast<const nlmsghdr*>(answer.data());
  if (!NLMSG_OK(header, static_cast<std::uint32_t>(left)) || header->nlmsg_type != RTM_NEWROUTE)
    return "";
  left = static_cast<int>(RTM_PAYLOAD(header));
  const auto* route = static_cast<const rtmsg*>(NLMSG_DATA(header));
  for (const rtattr* a = RTM_RTA(route); RTA_OK(a, left); a = RTA_NEXT(a, left)) {
    unsigned index = 0;
    if (a->rta_type != RTA_OIF) continue;
    std::memcpy(&index, RTA_DATA(a), sizeof index);
    std::array<char, IF_NAMESIZE> name{};
    return if_indextoname(index, name.data()) == nullptr ? "" : name.data();
  }
  return "";
}

void route_over_loopback(in_addr group) {
  const int error =
      error_in(loopback_request(RTM_NEWROUTE, NLM_F_CREATE | NLM_F_REPLACE, group).answer());
  if (error != 0) throw std::system_error(error, std::generic_category(), "adding a route over lo");
}

void remove_loopback_route(in_addr group) {
  const int error = error_in(loopback_request(RTM_DELROUTE, 0, group).answer());
  if (error != 0 && error != ESRCH) {
    throw std::system_error(error, std::generic_category(), "removing the route over lo");
  }
}

}  // namespace tether
