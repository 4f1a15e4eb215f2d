#include "can_bridge/bus/link_monitor.hpp"

#include <net/if.h>
// <net/if.h> comes first: the kernel's header then leaves out what both define.
#include <linux/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <utility>

#include "can_bridge/bus/link_service.hpp"
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

}  // namespace tether
