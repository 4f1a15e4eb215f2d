#include "can_bridge/bus/link_monitor.hpp"

#include <net/if.h>
// <net/if.h> comes first: the kernel's header then leaves out what both define.
#include <linux/can/netlink.h>
#include <linux/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <utility>

#include "common/base/rtnetlink.hpp"

namespace tether {
namespace {

template <class T>
T read_as(const void* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

const rtattr* find_in(const rtattr* parent, unsigned short type) {
  return parent == nullptr ? nullptr : find_attribute(RTA_DATA(parent), RTA_PAYLOAD(parent), type);
}

CanLink::Controller controller_of(const rtattr* link_info) {
  const rtattr* kind = find_in(link_info, IFLA_INFO_KIND);
  if (kind == nullptr ||
      std::string_view(static_cast<const char*>(RTA_DATA(kind)), RTA_PAYLOAD(kind)).substr(0, 4) !=
          std::string_view("can\0", 4)) {
    return CanLink::Controller::none;
  }
  const rtattr* state = find_in(find_in(link_info, IFLA_INFO_DATA), IFLA_CAN_STATE);
  if (state == nullptr || RTA_PAYLOAD(state) < sizeof(std::uint32_t)) {
    return CanLink::Controller::none;
  }
  switch (read_as<std::uint32_t>(RTA_DATA(state))) {
    case CAN_STATE_ERROR_ACTIVE:
    case CAN_STATE_ERROR_WARNING:
      return CanLink::Controller::active;
    case CAN_STATE_ERROR_PASSIVE:
      return CanLink::Controller::passive;
    case CAN_STATE_BUS_OFF:
      return CanLink::Controller::bus_off;
    default:
      return CanLink::Controller::stopped;
  }
}

CanLink parse_link(const nlmsghdr* message) {
  const auto* info = static_cast<const ifinfomsg*>(NLMSG_DATA(message));
  CanLink link;
  link.index = info->ifi_index;
  link.up = (info->ifi_flags & IFF_UP) != 0;
  link.controller =
      controller_of(find_attribute(IFLA_RTA(info), IFLA_PAYLOAD(message), IFLA_LINKINFO));
  return link;
}

}  // namespace

CanLinkMonitor::CanLinkMonitor(std::string interface) : interface_(std::move(interface)) {
  events_fd_ = open_rtnetlink(RTMGRP_LINK, SOCK_NONBLOCK);
  request_fd_ = open_rtnetlink(0, 0);
}

CanLinkMonitor::~CanLinkMonitor() {
  close(events_fd_);
  close(request_fd_);
}

std::optional<CanLink> CanLinkMonitor::query() const {
  RtnetlinkRequest<ifinfomsg> request(RTM_GETLINK, 0);
  request.add(IFLA_IFNAME, interface_.c_str(), interface_.size() + 1);
  RtnetlinkAnswer answer;
  request.exchange(request_fd_, answer);
  const nlmsghdr* message = answer.first(RTM_NEWLINK);
  if (message == nullptr) return std::nullopt;
  return parse_link(message);
}

CanLinkMonitor::Changes CanLinkMonitor::drain(int index) const {
  Changes changes;
  RtnetlinkAnswer answer;
  for (;;) {
    answer.size = recv(events_fd_, answer.bytes.data(), answer.bytes.size(), 0);
    // ENOBUFS: so many changes that some were lost. query() tells what came of them.
    if (answer.size < 0 && (errno == EINTR || errno == ENOBUFS)) continue;
    if (answer.size <= 0) return changes;
    auto left = static_cast<unsigned int>(answer.size);
    const auto* m = reinterpret_cast<const nlmsghdr*>(answer.bytes.data());
    for (; NLMSG_OK(m, left); m = NLMSG_NEXT(m, left)) {
      if (m->nlmsg_len < NLMSG_LENGTH(sizeof(ifinfomsg))) continue;
      const auto info = read_as<ifinfomsg>(NLMSG_DATA(m));
      // A network bridge reports with a family of its own that a link has left it.
      if (info.ifi_family != AF_UNSPEC || info.ifi_index != index) continue;
      if (m->nlmsg_type == RTM_DELLINK) changes.deleted = true;
      if (m->nlmsg_type == RTM_NEWLINK && (info.ifi_flags & IFF_UP) == 0) changes.was_down = true;
    }
  }
}

int CanLinkMonitor::set_up(int index, bool up) const {
  return change(index, up ? IFF_UP : 0, IFF_UP);
}

// The kernel asks for the permission before it looks at what is to be changed.
bool CanLinkMonitor::may_change(int index) const { return change(index, 0, 0) == 0; }

int CanLinkMonitor::change(int index, unsigned int flags, unsigned int which) const {
  RtnetlinkRequest<ifinfomsg> request(RTM_NEWLINK, NLM_F_ACK);
  request.body().ifi_index = index;
  request.body().ifi_flags = flags;
  request.body().ifi_change = which;
  RtnetlinkAnswer answer;
  request.exchange(request_fd_, answer);
  return answer.error();
}

}  // namespace tether
