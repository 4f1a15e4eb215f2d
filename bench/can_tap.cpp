#include "bench/can_tap.hpp"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cstring>
#include <ctime>

#include "common/base/errors.hpp"

namespace tether::bench {
namespace {

constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

std::int64_t nanoseconds(const timespec& t) { return t.tv_sec * kNanosecondsPerSecond + t.tv_nsec; }

int open_socket(const std::string& interface) {
  const int fd =
      check_system_call("opening a CAN socket", socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW));
  const int on = 1;
  const int buffer_bytes = 1 << 20;  // some seconds of traffic
  setsockopt(fd, SOL_SOCKET, SO_RCVBUFFORCE, &buffer_bytes, sizeof buffer_bytes);
  check_system_call("asking for time stamps",
                    setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on));
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = static_cast<int>(if_nametoindex(interface.c_str()));
  if (address.can_ifindex == 0) check_system_call("looking for the interface " + interface, -1);
  check_system_call("binding a socket to " + interface,
                    bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address));
  return fd;
}

}  // namespace

std::int64_t wall_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return nanoseconds(now);
}

CanTap::CanTap(const std::string& interface, const std::vector<std::uint32_t>& ids)
    : fd_(open_socket(interface)) {
  constexpr canid_t kFlags = CAN_EFF_FLAG | CAN_RTR_FLAG;
  std::vector<can_filter> wanted;
  for (const std::uint32_t id : ids) wanted.push_back({id, kFlags | CAN_SFF_MASK});
  if (wanted.empty()) wanted.push_back({0, kFlags});
  check_system_call("setting filters",
                    setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FILTER, wanted.data(),
                               static_cast<socklen_t>(wanted.size() * sizeof(can_filter))));
}

CanTap::~CanTap() { close(fd_); }

void CanTap::send(const CanFrame& frame) const {
  can_frame raw{};
  raw.can_id = frame.id;
  raw.can_dlc = frame.size;
  std::copy(frame.data.begin(), frame.data.end(), std::begin(raw.data));
  check_system_call("sending a CAN frame", static_cast<int>(write(fd_, &raw, sizeof raw)));
}

std::optional<StampedFrame> CanTap::receive(int timeout_ms) const {
  if (timeout_ms > 0) {
    pollfd wanted{fd_, POLLIN, 0};
    check_system_call("waiting for a CAN frame", poll(&wanted, 1, timeout_ms));
  }
  can_frame raw{};
  iovec vector{&raw, sizeof raw};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec))> control{};
  msghdr message{};
  message.msg_iov = &vector;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  if (recvmsg(fd_, &message, MSG_DONTWAIT) < 0) {
    if (errno == EAGAIN) return std::nullopt;
    check_system_call("receiving a CAN frame", -1);
  }
  StampedFrame result;
  result.frame = CanFrame::make(
      raw.can_id & CAN_EFF_MASK,
      std::span(std::begin(raw.data), std::min<std::size_t>(raw.can_dlc, CAN_MAX_DLEN)));
  const cmsghdr* header = CMSG_FIRSTHDR(&message);
  assert(header != nullptr && header->cmsg_type == SCM_TIMESTAMPNS);
  timespec stamp{};
  std::memcpy(&stamp, CMSG_DATA(header), sizeof stamp);
  result.wall_ns = nanoseconds(stamp);
  return result;
}

}  // namespace tether::bench
