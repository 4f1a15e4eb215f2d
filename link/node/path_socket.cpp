#include "link/node/path_socket.hpp"

#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <optional>
#include <stdexcept>

#include "common/lcm/udp_sockets.hpp"

namespace tether::link {
namespace {

constexpr int kBufferBytes = 2 << 20;

sockaddr_in to_system(const Address& address) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(address.port);
  out.sin_addr.s_addr = htonl(address.ip);
  return out;
}

}  // namespace

std::int64_t wall_ns() {
  timespec t{};
  clock_gettime(CLOCK_REALTIME, &t);
  return t.tv_sec * 1'000'000'000LL + t.tv_nsec;
}

PathSocket::PathSocket(const PathConfig& config) {
  fd_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd_ < 0) {
    throw std::runtime_error(
        fmt::format("path \"{}\": no socket: {}", config.name, std::strerror(errno)));
  }
  try {
    open(config);
  } catch (...) {
    close(fd_);
    throw;
  }
}

void PathSocket::open(const PathConfig& config) {
  const auto set = [&](int level, int name, int value) {
    return setsockopt(fd_, level, name, &value, sizeof value) == 0;
  };
  const auto fail = [&](const std::string& what) {
    throw std::runtime_error(
        fmt::format("path \"{}\": {}: {}", config.name, what, std::strerror(errno)));
  };
  set(SOL_SOCKET, SO_RCVBUF, kBufferBytes);
  set(SOL_SOCKET, SO_SNDBUF, kBufferBytes);
  if (!set(SOL_SOCKET, SO_TIMESTAMPNS, 1)) fail("no times of arrival");
  if (!set(IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_DO)) fail("no path MTU");
  const std::string& interface = config.interface;
  if (!interface.empty() && setsockopt(fd_, SOL_SOCKET, SO_BINDTODEVICE, interface.c_str(),
                                       static_cast<socklen_t>(interface.size())) != 0) {
    fail(fmt::format("cannot use interface \"{}\" (`ip link` lists them)", interface));
  }
  const sockaddr_in own = to_system(config.bind);
  if (bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0) {
    fail(
        fmt::format("cannot bind to {} (is another tether-link running; is it an address of this "
                    "host?)",
                    to_text(config.bind)));
  }
}

PathSocket::~PathSocket() { close(fd_); }

bool PathSocket::send(const Address& to, ByteView datagram) {
  const sockaddr_in address = to_system(to);
  if (sendto(fd_, datagram.data(), datagram.size(), MSG_DONTWAIT,
             reinterpret_cast<const sockaddr*>(&address), sizeof address) >= 0) {
    return true;
  }
  ++unsent_;
  too_long_ = too_long_ || errno == EMSGSIZE;
  return false;
}

void PathSocket::receive(const std::function<void(const Address&, ByteView, std::int64_t)>& take) {
  // Errors here are those of single datagrams, or of an interface that is gone for a while.
  const int count = batch_.receive(fd_);
  for (std::size_t i = 0; static_cast<int>(i) < count; ++i) {
    const sockaddr_in& from = batch_.sender(i);
    const std::optional<std::int64_t> arrival_ns = batch_.arrival_ns(i);
    take({ntohl(from.sin_addr.s_addr), ntohs(from.sin_port)}, batch_.datagram(i),
         arrival_ns ? *arrival_ns : wall_ns());
  }
}

std::int64_t PathSocket::dropped() const { return dropped_datagrams({fd_}); }

}  // namespace tether::link
