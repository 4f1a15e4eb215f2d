#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>

#include "common/base/time.hpp"
#include "doors/link/wire.hpp"

namespace tether::link {

/// Cuts a message into pieces whose datagrams have `datagram_bytes` at most (at least
/// kSmallestDatagram), and hands over each, in order. Returns how many; 0, and none is handed over,
/// if the message or its channel's name is too long or the name is none.
std::size_t cut(std::string_view channel, ByteView bytes, std::size_t datagram_bytes,
                const std::function<void(const Piece&)>& take);

// Every IPv4 host must accept this (576 − 28).
inline constexpr std::size_t kSmallestDatagram = 548;

/// Which of two messages was sealed later, across sessions.
struct MessageNumber {
  std::uint64_t generation = 0;  ///< counts sessions
  std::uint64_t counter = 0;     ///< counter of the message's first piece
  bool operator<(const MessageNumber& other) const {
    return std::tie(generation, counter) < std::tie(other.generation, other.counter);
  }
};

/// Puts pieces together again. Bounded: so many messages and bytes at once, the oldest goes first;
/// and a message that is not complete after kPatience is given up.
class Reassembly {
 public:
  static constexpr std::size_t kMostMessages = 16;
  static constexpr std::size_t kMostBytes = 4 * kMostMessageBytes;
  static constexpr Duration kPatience = std::chrono::seconds{1};

  struct Whole {
    MessageNumber number;
    std::string_view channel;
    ByteView bytes;  ///< until the next call
  };
  /// A piece comes once: the session sees to that. `message`: of the piece's first one.
  std::optional<Whole> take(Instant now, MessageNumber message, const Piece& piece);
  /// A newer message of this channel is there: gives up older ones that are not complete.
  void drop_older(std::string_view channel, MessageNumber than);

  std::int64_t incomplete() const { return incomplete_; }
  std::size_t bytes() const { return bytes_; }

 private:
  struct Partial {
    Instant begin;
    std::string channel;
    std::vector<Bytes> pieces;
    std::size_t missing = 0;
    std::size_t bytes = 0;
  };
  using Partials = std::map<MessageNumber, Partial>;

  void give_up(Partials::iterator partial);
  void make_room(Instant now);

  Partials partials_;
  std::size_t bytes_ = 0;
  std::int64_t incomplete_ = 0;
  std::string channel_;
  Bytes whole_;
};

}  // namespace tether::link
