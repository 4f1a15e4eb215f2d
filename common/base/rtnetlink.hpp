#pragma once

#include <linux/rtnetlink.h>
#include <sys/types.h>

#include <array>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace tether {

/// Opens a socket of rtnetlink (man 7 rtnetlink), by which the kernel is asked about interfaces,
/// addresses and routes, and tells their changes. `groups` (RTMGRP_...) are the changes that it
/// hears, `flags` those of socket(2). The caller closes it. Throws std::system_error.
int open_rtnetlink(std::uint32_t groups, int flags);

/// Messages that recv(2) left in a buffer; they and their attributes are aligned to 4 bytes.
struct RtnetlinkAnswer {
  alignas(nlmsghdr) std::array<char, 32768> bytes;
  ssize_t size = -1;

  /// Returns the first message, or nullptr if it is of another type.
  const nlmsghdr* first(std::uint16_t type) const;
  /// Returns the error number of an acknowledgement: 0 if the request was carried out, EPROTO if
  /// the answer is no acknowledgement.
  int error() const;
};

/// Returns the attribute of that type in a list, or nullptr if the list lacks it.
const rtattr* find_attribute(const void* list, std::size_t size, unsigned short type);

/// Sends a request and waits for the kernel's first answer. Throws std::system_error.
void exchange_rtnetlink(int fd, const nlmsghdr& request, RtnetlinkAnswer& answer);

/// A request whose fixed part is `Body`: ifinfomsg for RTM_GETLINK, rtmsg for RTM_GETROUTE.
template <class Body>
class RtnetlinkRequest {
 public:
  RtnetlinkRequest(std::uint16_t type, std::uint16_t flags) {
    static_assert(sizeof(nlmsghdr) == NLMSG_HDRLEN && sizeof(Body) % NLMSG_ALIGNTO == 0);
    header_.nlmsg_len = NLMSG_LENGTH(sizeof(Body));
    header_.nlmsg_type = type;
    header_.nlmsg_flags = static_cast<std::uint16_t>(NLM_F_REQUEST | flags);
  }

  Body& body() { return body_; }

  void add(std::uint16_t type, const void* data, std::size_t size) {
    const std::size_t at = header_.nlmsg_len - NLMSG_LENGTH(sizeof(Body));
    assert(at + RTA_SPACE(size) <= attributes_.size());
    const rtattr attribute{static_cast<std::uint16_t>(RTA_LENGTH(size)), type};
    std::memcpy(attributes_.data() + at, &attribute, sizeof attribute);
    std::memcpy(attributes_.data() + at + RTA_LENGTH(0), data, size);
    header_.nlmsg_len += static_cast<std::uint32_t>(RTA_SPACE(size));
  }

  void exchange(int fd, RtnetlinkAnswer& answer) const { exchange_rtnetlink(fd, header_, answer); }

 private:
  nlmsghdr header_{};
  Body body_{};
  std::array<char, 128> attributes_{};
};

}  // namespace tether
