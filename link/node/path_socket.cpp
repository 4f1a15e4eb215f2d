#include "link/node/path_socket.hpp"

#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>
#include <vector>

#include "common/lcm/udp_sockets.hpp"

namespace tether::link {
namespace {

constexpr std::size_t kDatagrams = 32;  // received at once
constexpr std::size_t kDatagramBytes = 65536;
constexpr int kBufferBytes = 2 << 20;

std::int64_t to_ns(const timespec& t) { return t.tv_sec * 1'000'000'000LL + t.tv_nsec; }

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
  return to_ns(t);
}

/// Room for the datagrams of one system call.
class PathSocket::Batch {
 public:
  Batch() : bytes_(kDatagrams * kDatagramBytes) {
    for (std::size_t i = 0; i < kDatagrams; ++i) {
      parts_[i] = {bytes_.data() + i * kDatagramBytes, kDatagramBytes};
      messages_[i].msg_hdr.msg_iov = &parts_[i];
      messages_[i].msg_hdr.msg_iovlen = 1;
      messages_[i].msg_hdr.msg_name = &senders_[i];
      messages_[i].msg_hdr.msg_control = &arrivals_[i];
    }
  }
  std::size_t receive(int fd) {
    for (mmsghdr& m : messages_) {
      m.msg_hdr.msg_namelen = sizeof(sockaddr_in);
      m.msg_hdr.msg_controllen = sizeof(Arrival);
    }
    // Errors here are those of single datagrams, or of an interface that is gone for a while.
    const int count = recvmmsg(fd, messages_.data(), kDatagrams, MSG_DONTWAIT, nullptr);
    return count < 0 ? 0 : static_cast<std::size_t>(count);
  }
  Address sender(std::size_t i) const {
    return {ntohl(senders_[i].sin_addr.s_addr), ntohs(senders_[i].sin_port)};
  }
  std::int64_t arrival_ns(std::size_t i) const {
    const cmsghdr& note = arrivals_[i].note;
    if (messages_[i].msg_hdr.msg_controllen < sizeof(cmsghdr) ||
        note.cmsg_type != SCM_TIMESTAMPNS) {
      return wall_ns();
    }
    timespec time{};
    std::memcpy(&time, CMSG_DATA(&note), sizeof time);
    return to_ns(time);
  }
  ByteView datagram(std::size_t i) const {
    return {bytes_.data() + i * kDatagramBytes, messages_[i].msg_len};
  }

 private:
  union Arrival {
    cmsghdr note;
    std::array<char, CMSG_SPACE(sizeof(timespec))> room;
  };

  std::vector<std::uint8_t> bytes_;
  std::array<Arrival, kDatagrams> arrivals_{};
  std::array<iovec, kDatagrams> parts_{};
  std::array<sockaddr_in, kDatagrams> senders_{};
  std::array<mmsghdr, kDatagrams> messages_{};
};

PathSocket::PathSocket(const PathConfig& config) : batch_(std::make_unique<Batch>()) {
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
  const std::size_t count = batch_->receive(fd_);
  for (std::size_t i = 0; i < count; ++i) {
    take(batch_->sender(i), batch_->datagram(i), batch_->arrival_ns(i));
  }
}

std::int64_t PathSocket::dropped() const { return dropped_datagrams({fd_}); }

}  // namespace tether::link
