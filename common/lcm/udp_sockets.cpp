#include "common/lcm/udp_sockets.hpp"

#include <arpa/inet.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/types.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "common/base/errors.hpp"
#include "common/lcm/lcm_url.hpp"

namespace tether {
namespace {

constexpr char kLoopback[] = "lo";

int loopback_index() { return static_cast<int>(if_nametoindex(kLoopback)); }

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

int open_udpm_receiver(const std::string& url) {
  const int fd = udp_socket();
  // The same as in LCM, so that any number of programs hear the same port.
  set_option(fd, SOL_SOCKET, SO_REUSEADDR, 1, "sharing the port");
  set_option(fd, SOL_SOCKET, SO_REUSEPORT, 1, "sharing the port");
  set_option(fd, SOL_SOCKET, SO_RCVBUF, static_cast<int>(lcm_option(url, "recv_buf_size")),
             "setting the receive buffer");
  set_option(fd, SOL_SOCKET, SO_TIMESTAMPNS, 1, "asking for times of arrival");
  // Unlike LCM 1.3, which hears every group on its port.
  set_option(fd, IPPROTO_IP, IP_MULTICAST_ALL, 0, "choosing the multicast group");
  // To the group, so that no datagram to another address of this host is heard.
  const sockaddr_in group = udpm_address(url);
  check_system_call("binding to the port of " + url,
                    bind(fd, reinterpret_cast<const sockaddr*>(&group), sizeof group));
  if (!join_udpm_group(fd, url)) check_system_call("joining " + url, -1);
  return fd;
}

bool join_udpm_group(int fd, const std::string& url) {
  ip_mreqn group{};
  group.imr_multiaddr = udpm_address(url).sin_addr;
  const auto join = [&] {
    return setsockopt(fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) == 0 ||
           errno == EADDRINUSE;  // a member already
  };
  const bool joined = join();
  if (lcm_option(url, "ttl") != 0) return joined;
  group.imr_ifindex = loopback_index();
  return (group.imr_ifindex != 0 && join()) || joined;
}

bool reachable_over_loopback(const std::string& url) {
  if (lcm_option(url, "ttl") != 0) return false;
  ifreq loopback{};
  std::strcpy(loopback.ifr_name, kLoopback);
  const int fd = udp_socket();
  const bool known = ioctl(fd, SIOCGIFFLAGS, &loopback) == 0;
  close(fd);
  return known && (loopback.ifr_flags & IFF_UP) != 0;
}

bool send_udpm(int fd, const std::string& url, msghdr& message) {
  if (sendmsg(fd, &message, 0) >= 0) return true;
  const bool no_way = errno == ENETUNREACH || errno == EHOSTUNREACH || errno == ENETDOWN;
  if (!no_way || lcm_option(url, "ttl") != 0) return false;
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(in_pktinfo))> room{};
  msghdr over_loopback = message;
  over_loopback.msg_control = room.data();
  over_loopback.msg_controllen = room.size();
  cmsghdr* const note = CMSG_FIRSTHDR(&over_loopback);
  note->cmsg_level = IPPROTO_IP;
  note->cmsg_type = IP_PKTINFO;
  note->cmsg_len = CMSG_LEN(sizeof(in_pktinfo));
  in_pktinfo by{};
  by.ipi_ifindex = loopback_index();
  by.ipi_spec_dst.s_addr = htonl(INADDR_LOOPBACK);
  std::memcpy(CMSG_DATA(note), &by, sizeof by);
  return by.ipi_ifindex != 0 && sendmsg(fd, &over_loopback, 0) >= 0;
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
