#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace tether {

/// Room for the UDP datagrams of one system call, each of any length, with their senders and the
/// kernel's times of arrival (which the socket must ask for: SO_TIMESTAMPNS).
class DatagramBatch {
 public:
  static constexpr std::size_t kDatagrams = 32;  ///< at once

  DatagramBatch();
  DatagramBatch(const DatagramBatch&) = delete;
  DatagramBatch& operator=(const DatagramBatch&) = delete;

  /// Takes what waits, at most kDatagrams, without waiting itself: how many; negative, with errno,
  /// as recvmmsg(2). What the others tell is valid until the next call.
  int receive(int fd);

  const sockaddr_in& sender(std::size_t i) const { return senders_[i]; }
  /// Nanoseconds since 1970; nullopt if the kernel did not tell.
  std::optional<std::int64_t> arrival_ns(std::size_t i) const;
  bool truncated(std::size_t i) const { return (messages_[i].msg_hdr.msg_flags & MSG_TRUNC) != 0; }
  std::span<const std::uint8_t> datagram(std::size_t i) const;

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

}  // namespace tether
