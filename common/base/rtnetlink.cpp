#include "common/base/rtnetlink.hpp"

#include <sys/socket.h>

#include <cerrno>

#include "common/base/errors.hpp"

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

const nlmsghdr* RtnetlinkAnswer::first(std::uint16_t type) const {
  const auto* message = reinterpret_cast<const nlmsghdr*>(bytes.data());
  return NLMSG_OK(message, size) && message->nlmsg_type == type ? message : nullptr;
}

int RtnetlinkAnswer::error() const {
  const nlmsghdr* message = first(NLMSG_ERROR);
  return message == nullptr ? EPROTO : -static_cast<const nlmsgerr*>(NLMSG_DATA(message))->error;
}

const rtattr* find_attribute(const void* list, std::size_t size, unsigned short type) {
  auto left = static_cast<unsigned int>(size);
  const auto* a = static_cast<const rtattr*>(list);
  for (; RTA_OK(a, left); a = RTA_NEXT(a, left)) {
    if ((a->rta_type & NLA_TYPE_MASK) == type) return a;
  }
  return nullptr;
}

void exchange_rtnetlink(int fd, const nlmsghdr& request, RtnetlinkAnswer& answer) {
  check_system_call("asking rtnetlink", static_cast<int>(send(fd, &request, request.nlmsg_len, 0)));
  do {
    answer.size = recv(fd, answer.bytes.data(), answer.bytes.size(), 0);
  } while (answer.size < 0 && errno == EINTR);
  check_system_call("reading rtnetlink's answer", static_cast<int>(answer.size));
}

}  // namespace tether
