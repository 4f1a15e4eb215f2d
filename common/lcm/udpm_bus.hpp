#pragma once

#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/lcm/host_routes.hpp"
#include "common/lcm/lcm_datagrams.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

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

/// A real LCM network over UDP multicast by sockets of our own: it is several times cheaper per
/// message than LCM's receiving thread, and indifferent to fragments that crash LCM. It never
/// receives its own messages, which it recognises by the sender's port and that the address is this
/// host's. Other LCM programs cannot tell it from LCM.
///
/// With ttl=0 the network is this host's alone: datagrams of other hosts are counted and ignored,
/// and buses hear each other whatever happens to the route by which the group is reached.
///
/// Handlers run in the loop's thread. What waits, waits in the kernel's buffer (the URL's
/// recv_buf_size), whose drops are counted. A bus without subscribers does not receive.
class UdpmBus final : public Bus {
 public:
  /// `url` is udpm. Throws as reachable_lcm_url() does, but not with ttl=0 and a loopback
  /// interface; and if the system has no socket left. `loop` must outlive the bus. `filter`: asked
  /// once for each message that a subscription matches.
  UdpmBus(const std::string& url, EventLoop& loop, Filter filter = {});
  ~UdpmBus() override;

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override;
  /// Whatever `queue_capacity`.
  void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) override;
  bool hears_itself() const override { return false; }
  /// The URL in use, including the buffer size.
  const std::string& url() const { return url_; }
  /// Datagrams dropped by the kernel, malformed ones, own ones and those of other hosts, incomplete
  /// messages, messages that the filter refused, publish failures.
  void list_counters(CounterList& out) const override;

 private:
  struct Subscription {
    std::optional<Pattern> channel;  ///< all, if none
    Handler handler;
  };

  void listen();
  void receive();
  bool refresh();
  bool is_of_this_host(in_addr sender);
  void ignore(in_addr sender);
  void hear(std::uint64_t sender, std::int64_t arrival_utime,
            std::span<const std::uint8_t> datagram);

  EventLoop& loop_;
  Filter filter_;
  std::string url_;
  int sending_fd_ = -1;
  int receiving_fd_ = -1;
  sockaddr_in group_{};
  in_port_t own_port_ = 0;
  bool local_ = true;                          ///< ttl=0
  std::optional<OwnAddresses> own_addresses_;  ///< once it receives
  std::uint32_t number_ = 0;
  std::unique_ptr<DatagramBatch> batch_;
  LcmAssembler assembler_;
  std::vector<Subscription> subscriptions_;
  std::int64_t own_ = 0;
  std::int64_t of_other_hosts_ = 0;
  std::int64_t truncated_ = 0;
  std::int64_t refused_ = 0;
  std::int64_t publish_failures_ = 0;
};

/// The LCM network of this URL: a UdpmBus for udpm://, a LcmBus for tcpq://. Throws as they do.
/// `loop` must outlive the bus. Messages that `filter` refuses are counted and not delivered. It
/// has no effect over tcpq, because LCM does not tell who sent a message.
std::unique_ptr<Bus> open_bus(const std::string& url, EventLoop& loop, Bus::Filter filter = {});

}  // namespace tether
