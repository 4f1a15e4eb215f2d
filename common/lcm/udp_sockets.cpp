#include "common/lcm/udp_sockets.hpp"

#include <arpa/inet.h>
#include <ifaddrs.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/types.h>

#include <array>

#include "common/base/system_error.hpp"
#include "common/lcm/lcm_url.hpp"

namespace tether {
namespace {

int udp_socket() {
  return check_system_call("opening a UDP socket", socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
}

template <class Value>
void set_option(int fd, int level, int name, const Value& value, const std::string& what) {
  check_system_call(what, setsockopt(fd, level, name, &value, sizeof value));
}

sockaddr_in address_of(in_addr_t ip, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = ip;
  return address;
}

bool is_udp_socket(int fd, std::uint16_t port) {
  int type = 0;
  socklen_t size = sizeof type;
  if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM) return false;
  sockaddr_in address{};
  size = sizeof address;
  return getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
         address.sin_family == AF_INET && ntohs(address.sin_port) == port;
}

}  // namespace

int open_udpm_sender(const std::string& url) {
  const int fd = udp_socket();
  set_option(fd, IPPROTO_IP, IP_MULTICAST_TTL, static_cast<int>(lcm_option(url, "ttl")),
             "setting the multicast TTL");
  const sockaddr_in any = address_of(htonl(INADDR_ANY), 0);
  check_system_call("binding to a port",
                    bind(fd, reinterpret_cast<const sockaddr*>(&any), sizeof any));
  return fd;
}

sockaddr_in udpm_address(const std::string& url) {
  return address_of(inet_addr(multicast_group(url).c_str()), lcm_port(url));
}

bool is_own_address(in_addr address) {
  if (address.s_addr == htonl(INADDR_ANY)) return true;
  ifaddrs* all = nullptr;
  if (getifaddrs(&all) != 0) return false;
  bool own = false;
  for (const ifaddrs* one = all; one != nullptr; one = one->ifa_next) {
    if (one->ifa_addr == nullptr || one->ifa_addr->sa_family != AF_INET) continue;
    const auto* found = reinterpret_cast<const sockaddr_in*>(one->ifa_addr);
    own = own || found->sin_addr.s_addr == address.s_addr;
  }
  freeifaddrs(all);
  return own;
}

int open_udpm_receiver(const std::string& url) {
  const int fd = udp_socket();
  // As LCM does, so that any number of programs hear the same port.
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1, "sharing the port");
  set_option(fd, SOL_SOCKET, SO_REUSEPORT, 1, "sharing the port");
  set_option(fd, SOL_SOCKET, SO_RCVBUF, static_cast<int>(lcm_option(url, "recv_buf_size")),
             "setting the receive buffer");
  set_option(fd, SOL_SOCKET, SO_TIMESTAMPNS, 1, "asking for times of arrival");
  // Unlike LCM 1.3, which hears every group on its port.
  set_option(fd, IPPROTO_IP, IP_MULTICAST_ALL, 0, "choosing the multicast group");
  const sockaddr_in any = address_of(htonl(INADDR_ANY), lcm_port(url));
  check_system_call("binding to the port of " + url,
                    bind(fd, reinterpret_cast<const sockaddr*>(&any), sizeof any));
  ip_mreq group{};
  group.imr_multiaddr.s_addr = inet_addr(multicast_group(url).c_str());
  set_option(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, group, "joining " + url);
  return fd;
}

std::vector<int> udp_sockets(std::uint16_t port) {
  constexpr int kMaxFd = 1024;  // LCM 1.3.1 can use no larger ones
  std::vector<int> sockets;
  for (int fd = 0; fd < kMaxFd; ++fd) {
    if (is_udp_socket(fd, port)) sockets.push_back(fd);
  }
  return sockets;
}

std::int64_t dropped_datagrams(const std::vector<int>& sockets) {
  std::int64_t dropped = 0;
  for (const int fd : sockets) {
    std::array<std::uint32_t, SK_MEMINFO_VARS> info{};
    socklen_t size = sizeof info;
    if (getsockopt(fd, SOL_SOCKET, SO_MEMINFO, info.data(), &size) == 0) {
      dropped += info[SK_MEMINFO_DROPS];
    }
  }
  return dropped;
}

}  // namespace tether
