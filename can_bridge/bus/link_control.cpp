#include "can_bridge/bus/link_control.hpp"

#include <net/if.h>
// <net/if.h> comes first: the kernel's header then leaves out what both define.
#include <linux/can/netlink.h>
#include <linux/if.h>
#include <linux/if_arp.h>
#include <linux/rtnetlink.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <string_view>

#include "common/base/system_error.hpp"

namespace tether {

int open_rtnetlink(std::uint32_t groups, int flags) {
  const int fd = check_system_call(
      "opening rtnetlink", socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC | flags, NETLINK_ROUTE));
  sockaddr_nl address{};
  address.nl_family = AF_NETLINK;
  address.nl_groups = groups;
  check_system_call("binding rtnetlink",
                    bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address));
  return fd;
}

namespace {

/// A request about a link; with room for its name as an attribute.
struct LinkRequest {
  nlmsghdr header{};
  ifinfomsg info{};
  std::array<char, RTA_SPACE(IFNAMSIZ)> attributes{};

  LinkRequest(std::uint16_t type, std::uint16_t flags) {
    header.nlmsg_len = NLMSG_LENGTH(sizeof info);
    header.nlmsg_type = type;
    header.nlmsg_flags = static_cast<std::uint16_t>(NLM_F_REQUEST | flags);
    info.ifi_family = AF_UNSPEC;
  }

  void add_name(const std::string& name) {
    const rtattr attribute{static_cast<std::uint16_t>(RTA_LENGTH(name.size() + 1)), IFLA_IFNAME};
    std::memcpy(attributes.data(), &attribute, sizeof attribute);
    std::memcpy(attributes.data() + RTA_LENGTH(0), name.c_str(), name.size() + 1);
    header.nlmsg_len += RTA_SPACE(static_cast<std::uint32_t>(name.size()) + 1);
  }
};
static_assert(offsetof(LinkRequest, info) == NLMSG_HDRLEN);
static_assert(offsetof(LinkRequest, attributes) == NLMSG_HDRLEN + sizeof(ifinfomsg));

/// What recv() left in a buffer; rtnetlink's messages and attributes are aligned to 4 bytes.
struct Answer {
  alignas(nlmsghdr) std::array<char, 32768> bytes;
  ssize_t size = -1;
};

/// Throws for anything that is wrong with rtnetlink itself.
void exchange(int fd, const LinkRequest& request, Answer& answer) {
  check_system_call("asking rtnetlink",
                    static_cast<int>(send(fd, &request, request.header.nlmsg_len, 0)));
  do {
    answer.size = recv(fd, answer.bytes.data(), answer.bytes.size(), 0);
  } while (answer.size < 0 && errno == EINTR);
  check_system_call("reading rtnetlink's answer", static_cast<int>(answer.size));
}

template <class T>
T read_as(const void* from) {
  T value;
  std::memcpy(&value, from, sizeof value);
  return value;
}

/// The attribute of that type in a list of attributes, nullptr if there is none.
const rtattr* find_attribute(const void* list, std::size_t size, unsigned short type) {
  auto left = static_cast<unsigned int>(size);
  const auto* a = static_cast<const rtattr*>(list);
  for (; RTA_OK(a, left); a = RTA_NEXT(a, left)) {
    if ((a->rta_type & NLA_TYPE_MASK) == type) return a;
  }
  return nullptr;
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
  LinkRequest request(RTM_GETLINK, 0);
  request.add_name(interface);
  Answer answer;
  exchange(fd_, request, answer);
  const auto* message = reinterpret_cast<const nlmsghdr*>(answer.bytes.data());
  if (!NLMSG_OK(message, answer.size) || message->nlmsg_type != RTM_NEWLINK) return std::nullopt;
  return parse_link(message);
}

bool CanLinkControl::is_can(int index) const {
  LinkRequest request(RTM_GETLINK, 0);
  request.info.ifi_index = index;
  Answer answer;
  exchange(fd_, request, answer);
  const auto* message = reinterpret_cast<const nlmsghdr*>(answer.bytes.data());
  return NLMSG_OK(message, answer.size) && message->nlmsg_type == RTM_NEWLINK &&
         static_cast<const ifinfomsg*>(NLMSG_DATA(message))->ifi_type == ARPHRD_CAN;
}

int CanLinkControl::change(int index, LinkChange change) const {
  LinkRequest request(RTM_NEWLINK, NLM_F_ACK);
  request.info.ifi_index = index;
  request.info.ifi_flags = change == LinkChange::up ? IFF_UP : 0;
  // The kernel asks for the permission before it looks at what is to be changed.
  request.info.ifi_change = change == LinkChange::none ? 0 : IFF_UP;
  Answer answer;
  exchange(fd_, request, answer);
  const auto* message = reinterpret_cast<const nlmsghdr*>(answer.bytes.data());
  if (!NLMSG_OK(message, answer.size) || message->nlmsg_type != NLMSG_ERROR) return EPROTO;
  return -static_cast<const nlmsgerr*>(NLMSG_DATA(message))->error;
}

}  // namespace tether
