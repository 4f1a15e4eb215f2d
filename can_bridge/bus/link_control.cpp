#include "can_bridge/bus/link_control.hpp"

#include <net/if.h>
// <net/if.h> comes first: the kernel's header then leaves out what both define.
#include <linux/can/netlink.h>
#include <linux/if.h>
#include <linux/if_arp.h>
#include <unistd.h>

#include <cstdint>
#include <cstring>
#include <string_view>

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

CanLinkControl::CanLinkControl() : fd_(open_rtnetlink(0, 0)) {}

CanLinkControl::~CanLinkControl() { close(fd_); }

std::optional<CanLink> CanLinkControl::query(const std::string& interface) const {
  RtnetlinkRequest<ifinfomsg> request(RTM_GETLINK, 0);
  request.add(IFLA_IFNAME, interface.c_str(), interface.size() + 1);
  RtnetlinkAnswer answer;
  request.exchange(fd_, answer);
  const nlmsghdr* message = answer.first(RTM_NEWLINK);
  if (message == nullptr) return std::nullopt;
  return parse_link(message);
}

bool CanLinkControl::is_can(int index) const {
  RtnetlinkRequest<ifinfomsg> request(RTM_GETLINK, 0);
  request.body().ifi_index = index;
  RtnetlinkAnswer answer;
  request.exchange(fd_, answer);
  const nlmsghdr* message = answer.first(RTM_NEWLINK);
  return message != nullptr &&
         static_cast<const ifinfomsg*>(NLMSG_DATA(message))->ifi_type == ARPHRD_CAN;
}

int CanLinkControl::change(int index, LinkChange change) const {
  RtnetlinkRequest<ifinfomsg> request(RTM_NEWLINK, NLM_F_ACK);
  request.body().ifi_index = index;
  request.body().ifi_flags = change == LinkChange::up ? IFF_UP : 0;
  // The kernel asks for the permission before it looks at what is to be changed.
  request.body().ifi_change = change == LinkChange::none ? 0 : IFF_UP;
  RtnetlinkAnswer answer;
  request.exchange(fd_, answer);
  return answer.error();
}

}  // namespace tether
