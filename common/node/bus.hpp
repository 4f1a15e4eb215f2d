#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

#include "common/base/counters.hpp"

namespace tether {

/// One message as it travels: a channel name and LCM-encoded bytes.
struct Message {
  std::string_view channel;
  std::span<const std::uint8_t> bytes;
  /// Who published it, where the network tells: on UDP its address and port (sender_name()); else
  /// 0.
  std::uint64_t sender = 0;
  /// When it arrived, µs since 1970: on UDP by the kernel, so that waiting in this process does not
  /// count; 0 where the network does not tell.
  std::int64_t received_utime = 0;
};

/// Publish/subscribe of raw LCM messages. Implementations: InProcessBus (virtual time), LcmBus and
/// UdpmBus (real LCM), LockstepBus (real LCM in simulated time). Messages between one publisher and
/// one subscriber keep their order; a message published inside a handler is delivered later, never
/// recursively.
class Bus {
 public:
  using Handler = std::function<void(const Message&)>;
  /// Returns whether a message with a subscription is delivered.
  using Filter = std::function<bool(const Message&)>;

  virtual ~Bus() = default;

  virtual void publish(std::string_view channel, std::span<const std::uint8_t> bytes) = 0;

  /// `channel_regex` must match a channel's whole name, as in LCM. `queue_capacity` bounds what
  /// may wait unhandled (LCM drops the newest beyond it); consumers that want only the latest say
  /// 1, relays and recorders a large number. Subscribe before the loop runs, never in a handler.
  virtual void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) = 0;

  /// Whether a program hears on this bus what it has published on it.
  virtual bool hears_itself() const { return true; }

  /// Appends what went wrong on this network so far, for reports.
  virtual void list_counters(CounterList&) const {}

 protected:
  Bus() = default;
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;
};

/// Capacity for consumers that must see every message.
inline constexpr int kDeepQueue = 100'000;

}  // namespace tether
