#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <tuple>

#include "common/bus.hpp"
#include "common/time.hpp"

namespace tether {

/// Tells a relay's own messages from everybody else's. LCM names no sender, and a relay that takes
/// what it has published itself would feed itself for ever.
///
/// What was published is remembered, as network, channel and a hash of the bytes, until it is heard
/// once: as many messages are recognised as were published, not more, so that others may send the
/// very same bytes at the same time (a constant heartbeat) and each of theirs gets through.
///
/// An own message that is never heard (the socket's buffer was full) stays remembered for `memory`;
/// within that time an equal one of somebody else's would be taken for it. An own message that is
/// heard later than `memory` after it was published is taken for somebody else's. Of more than
/// `capacity` at once, the oldest are forgotten.
///
/// Pure: time is an argument and never goes back.
class EchoFilter {
 public:
  struct Counters {
    std::int64_t recognised = 0;
    std::int64_t unheard = 0;    ///< forgotten because `memory` was over
    std::int64_t forgotten = 0;  ///< because of `capacity`
  };

  EchoFilter(Duration memory, std::size_t capacity);

  /// This message is about to be published, and will be heard on the same network.
  void published(Instant now, std::size_t network, const Message& message);

  /// Whether this message, just heard, is an own one.
  bool heard(Instant now, std::size_t network, const Message& message);

  const Counters& counters() const { return counters_; }
  /// What is remembered; some of it may have been heard out of order.
  std::size_t size() const { return records_.size(); }

 private:
  struct Key {
    std::size_t network;
    std::size_t channel;  // hashes
    std::size_t bytes;
    std::size_t length;
    bool operator<(const Key& other) const {
      return std::tie(network, channel, bytes, length) <
             std::tie(other.network, other.channel, other.bytes, other.length);
    }
  };
  /// Of one key: how many of its records are still to be heard, and how many were.
  struct Count {
    std::size_t waiting = 0;
    std::size_t heard = 0;
  };
  struct Record {
    Instant end;
    std::map<Key, Count>::iterator count;
  };

  static Key key(std::size_t network, const Message& message);
  /// Returns whether it had been heard.
  bool forget_oldest();
  void forget_old(Instant now);

  Duration memory_;
  std::size_t capacity_;
  std::map<Key, Count> counts_;
  std::deque<Record> records_;  // in order of publication; of one key, the first are those heard
  std::size_t waiting_ = 0;
  Counters counters_;
};

}  // namespace tether
