#include "link/node/path_socket.hpp"

#include <fmt/format.h>
#include <net/if.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <ctime>
#include <optional>
#include <stdexcept>
#include <utility>

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

PathSocket::PathSocket(const PathConfig& config) : config_(config) {
  if (open() || errno == ENODEV || errno == EADDRNOTAVAIL) return;
  throw std::runtime_error(fmt::format("path \"{}\": {}", config_.name, trouble_));
}

PathSocket::~PathSocket() { shut(); }

void PathSocket::shut() {
  if (fd_ < 0) return;
  dropped_before_ += dropped_datagrams({fd_});
  close(std::exchange(fd_, -1));
}

bool PathSocket::fail(const std::string& what) {
  const int error = errno;
  trouble_ = fmt::format("{}: {}", what, std::strerror(error));
  shut();
  errno = error;
  return false;
}

bool PathSocket::open() {
  const std::string& interface = config_.interface;
  // Before it is bound: if another takes its place meanwhile, that is noticed.
  interface_index_ = if_nametoindex(interface.c_str());
  fd_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd_ < 0) return fail("no socket");
  const auto set = [this](int level, int name, int value) {
    return setsockopt(fd_, level, name, &value, sizeof value) == 0;
  };
  set(SOL_SOCKET, SO_RCVBUF, kBufferBytes);
  set(SOL_SOCKET, SO_SNDBUF, kBufferBytes);
  if (!set(SOL_SOCKET, SO_TIMESTAMPNS, 1)) return fail("no times of arrival");
  // Not DO, which believes any sender of ICMP packets: long PROBEs measure the size (PeerLink).
  if (!set(IPPROTO_IP, IP_MTU_DISCOVER, IP_PMTUDISC_PROBE)) return fail("no path MTU");
  if (!interface.empty() && setsockopt(fd_, SOL_SOCKET, SO_BINDTODEVICE, interface.c_str(),
                                       static_cast<socklen_t>(interface.size())) != 0) {
    return fail(fmt::format("cannot use interface \"{}\" (`ip link` lists them)", interface));
  }
  const sockaddr_in own = to_system(config_.bind);
  if (bind(fd_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0) {
    return fail(
        fmt::format("cannot bind to {} (is another tether-link running; is it an address of this "
                    "host?)",
                    to_text(config_.bind)));
  }
  trouble_.clear();
  return true;
}

bool PathSocket::is_current() const {
  return fd_ >= 0 && (config_.interface.empty() ||
                      if_nametoindex(config_.interface.c_str()) == interface_index_);
}

void PathSocket::reopen() {
  shut();
  open();
}

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

std::int64_t PathSocket::dropped() const {
  return dropped_before_ + (fd_ < 0 ? 0 : dropped_datagrams({fd_}));
}

}  // namespace tether::link
