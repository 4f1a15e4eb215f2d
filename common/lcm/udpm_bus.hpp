#pragma once

#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/bus/bus.hpp"
#include "common/lcm/datagram_batch.hpp"
#include "common/lcm/lcm_datagrams.hpp"
#include "common/lcm/own_addresses.hpp"
#include "common/loop/event_loop.hpp"

namespace tether {

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

}  // namespace tether
