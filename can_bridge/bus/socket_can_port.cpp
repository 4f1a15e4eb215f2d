#include "can_bridge/bus/socket_can_port.hpp"

#include <fmt/format.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "can_bridge/bus/link_service.hpp"
#include "common/base/errors.hpp"
#include "common/base/rtnetlink.hpp"

namespace tether {

CanLinkMonitor::CanLinkMonitor(std::string interface, std::string service)
    : interface_(std::move(interface)),
      service_(std::move(service)),
      events_fd_(open_rtnetlink(RTMGRP_LINK, SOCK_NONBLOCK)) {}

CanLinkMonitor::~CanLinkMonitor() { close(events_fd_); }

CanLinkMonitor::Changes CanLinkMonitor::drain(int index) const {
  Changes changes;
  RtnetlinkAnswer answer;
  for (;;) {
    const ssize_t size = recv(events_fd_, answer.bytes.data(), answer.bytes.size(), 0);
    // ENOBUFS: so many changes that some were lost. query() tells what came of them.
    if (size < 0 && (errno == EINTR || errno == ENOBUFS)) continue;
    if (size <= 0) return changes;
    auto left = static_cast<unsigned int>(size);
    const auto* m = reinterpret_cast<const nlmsghdr*>(answer.bytes.data());
    for (; NLMSG_OK(m, left); m = NLMSG_NEXT(m, left)) {
      if (m->nlmsg_len < NLMSG_LENGTH(sizeof(ifinfomsg))) continue;
      const auto* const info = static_cast<const ifinfomsg*>(NLMSG_DATA(m));
      // A network bridge reports with a family of its own that a link has left it.
      if (info->ifi_family != AF_UNSPEC || info->ifi_index != index) continue;
      if (m->nlmsg_type == RTM_DELLINK) changes.deleted = true;
      if (m->nlmsg_type == RTM_NEWLINK && (info->ifi_flags & IFF_UP) == 0) changes.was_down = true;
    }
  }
}

int CanLinkMonitor::change(int index, LinkChange change) const {
  const int error = control_.change(index, change);
  return error == EPERM ? ask_can_link_service(service_, index, change) : error;
}

namespace {

std::string checked_name(const std::string& name) {
  const auto unusable = [](char c) { return c <= ' ' || c == '/' || c == ':'; };
  if (!name.empty() && name.size() < IFNAMSIZ && std::none_of(name.begin(), name.end(), unusable)) {
    return name;
  }
  throw UsageError(
      fmt::format("CAN interface \"{}\": not a network interface's name, which has 1 to {} "
                  "characters without space, '/' and ':', such as can0 or vcan0",
                  name, IFNAMSIZ - 1));
}

int open_can_socket() {
  const int fd = socket(AF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
  if (fd < 0 && (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT)) {
    throw std::runtime_error(
        fmt::format("this kernel has no CAN (socket: {}): load its modules, as root: modprobe "
                    "can-raw; a kernel for containers or clouds may lack them (Debian: install "
                    "linux-image-amd64). In a clone of the source, tests/uml/with_can.sh COMMAND "
                    "runs a command in a kernel that has CAN",
                    std::strerror(errno)));
  }
  return check_system_call("opening a CAN socket", fd);
}

std::runtime_error missing(const std::string& interface) {
  const std::string how =
      interface.starts_with("vcan")
          ? fmt::format("create it, as root: ip link add dev {0} type vcan && ip link set {0} up",
                        interface)
          : fmt::format(
                "plug in the adapter, then, as root: ip link set {} up type can bitrate "
                "500000",
                interface);
  return std::runtime_error(fmt::format("no CAN interface {}: {}", interface, how));
}

template <class T>
void set_option(int fd, int level, int name, const T& value) {
  check_system_call("setting an option of the CAN socket",
                    setsockopt(fd, level, name, &value, sizeof value));
}

void set_options(int fd) {
  // Only error frames that tell the controller's state. Those of single bus errors could come as
  // often as frames.
  const can_err_mask_t errors = CAN_ERR_CRTL | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED;
  set_option(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors);
  set_option(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 0);
  set_option(fd, SOL_CAN_RAW, CAN_RAW_LOOPBACK, 1);
  set_option(fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, 0);
  set_option(fd, SOL_SOCKET, SO_RXQ_OVFL, 1);
  // The kernel's minimum. By default hundreds of frames could wait behind a stalled adapter.
  set_option(fd, SOL_SOCKET, SO_SNDBUF, 1024);
}

CanLink::Controller told_by(const can_frame& error) {
  if ((error.can_id & CAN_ERR_BUSOFF) != 0) return CanLink::Controller::bus_off;
  if ((error.can_id & CAN_ERR_CRTL) == 0) return CanLink::Controller::active;
  const bool passive = (error.data[1] & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0;
  return passive ? CanLink::Controller::passive : CanLink::Controller::active;
}

bool writable(int fd) {
  pollfd p{fd, POLLOUT, 0};
  return poll(&p, 1, 0) == 1 && (p.revents & POLLOUT) != 0;
}

}  // namespace

SocketCanPort::SocketCanPort(const std::string& interface, EventLoop& loop,
                             const std::string& link_service)
    : interface_(checked_name(interface)), loop_(loop), monitor_(interface_, link_service) {
  close(open_can_socket());  // tells a kernel without CAN from a missing interface
  const std::optional<CanLink> link = monitor_.query();
  if (!link) throw missing(interface_);
  open(*link);
  set_state();
  counters_.state_changes = 0;
  loop_.add_fd(monitor_.fd(), [this](Instant) { on_link_change(); });
}

SocketCanPort::~SocketCanPort() {
  loop_.remove_fd(monitor_.fd());
  close_socket();
}

void SocketCanPort::open(const CanLink& link) {
  assert(fd_ < 0);
  fd_ = open_can_socket();
  try {
    set_options(fd_);
    apply_filters();
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = link.index;
    if (bind(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      throw std::runtime_error(
          fmt::format("{} cannot be used for CAN: {}", interface_, std::strerror(errno)));
    }
  } catch (...) {
    close(fd_);
    fd_ = -1;
    throw;
  }
  link_ = link;
  overflow_seen_ = 0;
  half_restarted_ = false;
  forget_failures();
  loop_.add_fd(fd_, [this](Instant) { read_frames(); });
}

void SocketCanPort::close_socket() {
  if (fd_ < 0) return;
  loop_.remove_fd(fd_);
  close(fd_);
  fd_ = -1;
}

void SocketCanPort::on_frame(std::vector<CanFilter> filters, FrameHandler handler) {
  assert(filters.size() <= CAN_RAW_FILTER_MAX);
  filters_ = std::move(filters);
  frame_handler_ = std::move(handler);
  if (fd_ >= 0) apply_filters();
}

void SocketCanPort::apply_filters() const {
  std::vector<can_filter> wanted;
  for (const CanFilter& f : filters_) {
    // With the flags in the mask, no frames of the other length pass, nor remote ones.
    const canid_t bits = f.extended ? CAN_EFF_MASK : CAN_SFF_MASK;
    wanted.push_back({.can_id = (f.id & bits) | (f.extended ? CAN_EFF_FLAG : 0),
                      .can_mask = (f.mask & bits) | CAN_EFF_FLAG | CAN_RTR_FLAG});
  }
  check_system_call("setting CAN filters",
                    setsockopt(fd_, SOL_CAN_RAW, CAN_RAW_FILTER, wanted.data(),
                               static_cast<socklen_t>(wanted.size() * sizeof(can_filter))));
}

bool SocketCanPort::send(const CanFrame& frame) {
  assert(frame.size <= CAN_MAX_DLEN);
  const bool possible = fd_ >= 0 && state_ != CanState::bus_off && state_ != CanState::down &&
                        // Writable means that half of what waited has gone: the bus takes frames
                        // again.
                        (state_ != CanState::stalled || writable(fd_));
  if (!possible) {
    ++counters_.send_dropped;
    return false;
  }
  can_frame raw{};
  raw.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0) | (frame.remote ? CAN_RTR_FLAG : 0);
  raw.can_dlc = frame.size;
  std::copy(frame.data.begin(), frame.data.end(), std::begin(raw.data));
  if (write(fd_, &raw, sizeof raw) != sizeof raw) {
    ++counters_.send_dropped;
    on_failed_send(errno);
    return false;
  }
  ++counters_.sent;
  send_fails_ = false;
  if (stalled_) {
    stalled_ = false;
    set_state();
  }
  return true;
}

void SocketCanPort::on_failed_send(int error) {
  if (error == ENETDOWN || error == ENXIO || error == ENODEV) {
    follow_link(error != ENETDOWN);
    return;
  }
  const Instant now = loop_.now();
  if (!send_fails_) send_fails_since_ = now;
  send_fails_ = true;
  if (now - send_fails_since_ <= kStallTime || stalled_) return;
  stalled_ = true;
  set_state();
}

void SocketCanPort::read_frames() {
  // Bounded, so that a flooded bus does not keep the loop from its timers.
  constexpr int kBurst = 64;
  for (int i = 0; i < kBurst && fd_ >= 0; ++i) {
    if (!read_frame()) return;
  }
}

bool SocketCanPort::read_frame() {
  can_frame frame{};
  iovec data{&frame, sizeof frame};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(std::uint32_t))> control{};
  msghdr message{};
  message.msg_iov = &data;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = recvmsg(fd_, &message, 0);
  if (size < 0) {
    if (errno == EINTR) return true;
    if (errno != EAGAIN) follow_link(errno == ENODEV);
    return false;
  }
  for (cmsghdr* c = CMSG_FIRSTHDR(&message); c != nullptr; c = CMSG_NXTHDR(&message, c)) {
    if (c->cmsg_level != SOL_SOCKET || c->cmsg_type != SO_RXQ_OVFL) continue;
    std::uint32_t dropped = 0;
    std::memcpy(&dropped, CMSG_DATA(c), sizeof dropped);
    counters_.rx_overflow += static_cast<std::uint32_t>(dropped - overflow_seen_);
    overflow_seen_ = dropped;
  }
  if (size != CAN_MTU || frame.can_dlc > CAN_MAX_DLEN) {
    ++counters_.malformed;
  } else if ((frame.can_id & CAN_ERR_FLAG) != 0) {
    on_error_frame(frame);
  } else {
    accept(frame);
  }
  return true;
}

void SocketCanPort::accept(const can_frame& frame) {
  CanFrame f = CanFrame::make(frame.can_id & CAN_EFF_MASK, {frame.data, frame.can_dlc});
  f.extended = (frame.can_id & CAN_EFF_FLAG) != 0;
  f.remote = (frame.can_id & CAN_RTR_FLAG) != 0;
  // The kernel's filter has done this already, but for frames queued before it was set.
  const bool wanted = std::any_of(filters_.begin(), filters_.end(),
                                  [&f](const CanFilter& filter) { return filter.passes(f); });
  if (!wanted) return;
  ++counters_.received;
  if (frame_handler_) frame_handler_(f);
}

void SocketCanPort::on_error_frame(const can_frame& frame) {
  ++counters_.error_frames;
  const CanLink::Controller told = told_by(frame);
  if (link_.controller != CanLink::Controller::none) {
    const CanLink::Controller asked = follow_link(false);
    const auto off = CanLink::Controller::bus_off;
    if (told == off && asked != off) ++counters_.error_frames_unconfirmed;
    return;
  }
  if (suspicion_ != CanLink::Controller::bus_off) suspicion_ = told;
  set_state();
}

void SocketCanPort::on_link_change() {
  const CanLinkMonitor::Changes changes = monitor_.drain(link_.index);
  if (changes.was_down) {  // perhaps for a moment only
    link_.up = false;
    forget_failures();
    set_state();
  }
  follow_link(changes.deleted);
}

CanLink::Controller SocketCanPort::follow_link(bool deleted) {
  const std::optional<CanLink> link = monitor_.query();
  if (fd_ >= 0 && (deleted || !link || link->index != link_.index)) close_socket();
  if (link && fd_ < 0) {
    try {
      open(*link);
      ++counters_.reopened;
    } catch (const std::exception&) {
      // Gone again already, or no CAN interface: the next change of a link tries again.
    }
  }
  if (link && fd_ >= 0) link_ = *link;
  if (link_.up) half_restarted_ = false;
  if (!link_.up) forget_failures();  // the queues are empty now
  const CanLink::Controller controller = link_.controller;
  set_state();  // last: the handler may call restart()
  return controller;
}

void SocketCanPort::forget_failures() {
  suspicion_ = CanLink::Controller::active;
  send_fails_ = stalled_ = false;
}

void SocketCanPort::set_state() {
  const CanLink::Controller controller =
      link_.controller == CanLink::Controller::none ? suspicion_ : link_.controller;
  CanState state = CanState::up;
  if (fd_ < 0) {
    state = CanState::absent;
  } else if (!link_.up || controller == CanLink::Controller::stopped) {
    state = CanState::down;
  } else if (controller == CanLink::Controller::bus_off) {
    state = CanState::bus_off;
  } else if (stalled_) {
    state = CanState::stalled;
  } else if (controller == CanLink::Controller::passive) {
    state = CanState::error_passive;
  }
  if (state == state_) return;
  state_ = state;
  ++counters_.state_changes;
  if (state_handler_) state_handler_(state);
}

bool SocketCanPort::restart(std::string& why) {
  if (state_ == CanState::absent) {
    why = missing(interface_).what();
    return false;
  }
  if (state_ == CanState::down && !half_restarted_) {
    why = fmt::format("{0} is down: as root: ip link set {0} up", interface_);
    return false;
  }
  int error = half_restarted_ ? 0 : monitor_.change(link_.index, LinkChange::down);
  if (error == 0) {
    error = monitor_.change(link_.index, LinkChange::up);
    half_restarted_ = error != 0;
  }
  if (error == 0) {
    ++counters_.restarts;
    int outdated = 0;  // events of an earlier down state
    socklen_t size = sizeof outdated;
    getsockopt(fd_, SOL_SOCKET, SO_ERROR, &outdated, &size);
    forget_failures();
  } else {
    why = fmt::format(
        "restarting {0} failed ({1}): as root: ip link set {0} down && ip link set "
        "{0} up{2}",
        interface_, std::strerror(error),
        error == EPERM ? ", or start tether-can-links.service" : "");
  }
  follow_link(monitor_.drain(link_.index).deleted);  // the earlier down state is known
  return error == 0;
}

std::string SocketCanPort::warning() const {
  if (interface_.starts_with("vcan") || interface_.starts_with("vxcan")) return "";
  if (fd_ < 0 || monitor_.change(link_.index, LinkChange::none) == 0) return "";
  return fmt::format(
      "cannot restart {0} after a stall: speeds that wait in its queue would still come out when "
      "the bus recovers: start tether-can-links.service, or give this program CAP_NET_ADMIN (as "
      "root: setcap cap_net_admin+ep <path of tether-can-bridge>)",
      interface_);
}

void SocketCanPort::list(CounterList& out) const {
  const Counters& c = counters_;
  out.emplace_back("can.sent", c.sent);
  out.emplace_back("can.received", c.received);
  out.emplace_back("can.send_dropped", c.send_dropped);
  out.emplace_back("can.rx_overflow", c.rx_overflow);
  out.emplace_back("can.malformed", c.malformed);
  out.emplace_back("can.error_frames", c.error_frames);
  out.emplace_back("can.error_frames_unconfirmed", c.error_frames_unconfirmed);
  out.emplace_back("can.restarts", c.restarts);
  out.emplace_back("can.reopened", c.reopened);
  out.emplace_back("can.state_changes", c.state_changes);
}

}  // namespace tether
