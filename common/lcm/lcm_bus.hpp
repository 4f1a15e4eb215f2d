#pragma once

#include <cstdint>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace lcm {
class LCM;
}

namespace tether {

/// checked_lcm_url(), and the kernel has a route there. Throws UsageError for a malformed URL,
/// std::runtime_error with the command that mends it where there is no route.
std::string reachable_lcm_url(const std::string& url);

/// A real LCM network, driven by an event loop. Handlers run in the loop's thread; an exception
/// from one is carried past LCM's C frames and rethrown to the loop.
///
/// A bus without subscribers does not receive.
///
/// Two crafted fragments can crash any program that receives by LCM's library over udpm (LCM pull
/// request 628): open_bus() takes it for tcpq only.
class LcmBus final : public Bus {
 public:
  /// Throws as reachable_lcm_url() does. `loop` must outlive the bus.
  LcmBus(const std::string& url, EventLoop& loop);
  ~LcmBus() override;

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override;
  void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) override;

  /// Messages that LCM handed over with an impossible size (garbage on the port).
  std::uint64_t malformed() const { return malformed_; }
  /// Messages that LCM refused to send.
  std::uint64_t publish_failures() const { return publish_failures_; }

  /// Datagrams (a message is one, or one per 64 KiB) that the kernel dropped because this process
  /// did not read them in time; udpm only.
  std::int64_t datagrams_dropped() const;
  /// Appends all of these counters.
  void list_counters(CounterList& out) const override;

  const std::string& url() const { return url_; }

 private:
  struct Subscription;
  void listen();
  void handle_pending();

  EventLoop& loop_;
  std::string url_;
  std::unique_ptr<lcm::LCM> lcm_;
  std::vector<std::unique_ptr<Subscription>> subscriptions_;
  int fd_ = -1;               // readable when messages wait; −1 until the first subscription
  std::vector<int> sockets_;  // on which LCM receives
  std::uint64_t malformed_ = 0;
  std::uint64_t publish_failures_ = 0;
  std::exception_ptr handler_error_;
};

}  // namespace tether
