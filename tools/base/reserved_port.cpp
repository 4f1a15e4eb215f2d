#include "tools/base/reserved_port.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include "common/base/errors.hpp"

namespace tether {

ReservedPort::ReservedPort()
    : fd_(check_system_call("opening a socket", socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0))) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t size = sizeof address;
  const int on = 1, off = 0;
  // Bound alone; shared from then on, without hearing what is sent to groups.
  const bool done = bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
                    getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
                    setsockopt(fd_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0 &&
                    setsockopt(fd_, SOL_SOCKET, SO_REUSEPORT, &on, sizeof on) == 0 &&
                    setsockopt(fd_, IPPROTO_IP, IP_MULTICAST_ALL, &off, sizeof off) == 0;
  if (!done) {
    const int error = errno;
    close(fd_);
    throw std::system_error(error, std::generic_category(), "looking for a free port");
  }
  port_ = ntohs(address.sin_port);
}

ReservedPort::~ReservedPort() { close(fd_); }

std::string ReservedPort::lcm_url() const {
  return fmt::format("udpm://239.255.76.67:{}?ttl=0", port_);
}

}  // namespace tether
