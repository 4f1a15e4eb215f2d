#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/time.hpp"
#include "common/node/bus.hpp"
#include "common/node/event_loop.hpp"

namespace tether {

/// Tells whether one program sends a stream or several do at the same time, by who sent each of its
/// messages (Message::sender). One that falls silent when another begins has restarted. Senders
/// whose times overlap by kOverlap or more are several, for kMemory after the last message of
/// either; so it takes one more message of each than a restart would have. Pure; `now` must not go
/// backwards. Messages of which the network does not tell who sent them (0) do not count.
class SenderWatch {
 public:
  static constexpr Duration kOverlap = std::chrono::milliseconds{100};
  static constexpr Duration kMemory = std::chrono::seconds{2};
  /// Maximum number of senders that are remembered: those heard last.
  static constexpr std::size_t kSenders = 8;

  void heard(Instant now, std::uint64_t sender);

  /// Senders that send at the same time, in the order in which they began; empty if one does, or
  /// none.
  std::vector<std::uint64_t> several(Instant now) const;

 private:
  struct Sender {
    std::uint64_t name;
    Instant first, last;
  };
  static bool overlap(const Sender& a, const Sender& b);

  std::vector<Sender> senders_;  ///< by first
};

/// Watches channels on each of which one program alone should send.
class SoleSender {
 public:
  /// Told when several programs begin to send on a channel, in words.
  using Report = std::function<void(const std::string& line)>;

  /// Subscribes to these channels, before those who use what comes. `loop` and `bus` must outlive
  /// it. Without `report` it says so on stderr.
  SoleSender(EventLoop& loop, Bus& bus, const std::vector<std::string>& channels,
             Report report = {});

  /// Whether several programs send on this one of the channels now.
  bool several(std::string_view channel) const;
  /// "AGV/CMD_VEL: 10.0.0.2:40112 and 10.0.0.3:51200"; "" while there is one of each.
  std::string trouble() const;
  /// Appends "senders.several", how often it was noticed, if it ever was.
  void list(CounterList& out) const;

 private:
  struct Watched {
    std::string channel;
    SenderWatch watch;
    bool reported = false;
  };
  std::string text(const Watched& watched) const;
  void heard(Watched& watched, std::uint64_t sender);

  EventLoop& loop_;
  Report report_;
  std::list<Watched> channels_;
  bool any_named_ = false;  ///< the network has told of some message who sent it
  std::int64_t count_ = 0;
};

/// "10.0.0.2:40112" of a Message::sender; "this host's port 40112" where it came without address.
std::string sender_name(std::uint64_t sender);

}  // namespace tether
