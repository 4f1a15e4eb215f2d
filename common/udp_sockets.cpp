#include "common/udp_sockets.hpp"

#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/types.h>

#include <array>

namespace tether {
namespace {

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
