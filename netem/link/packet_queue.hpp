#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/time.hpp"

namespace tether {

/// Raw bytes on their way, never decoded.
struct Packet {
  std::string channel;  ///< under which they leave the link
  std::vector<std::uint8_t> bytes;
  std::size_t destination = 0;  ///< where to, for links that lead to several networks
};

/// Packets under way, in order of departure, then of arrival in the queue. Memory grows with the
/// largest number that were ever in it at once.
class PacketQueue {
 public:
  struct Ready {
    Instant arrival;
    Packet packet;
  };

  void push(Instant arrival, Instant departure, Packet&& packet);

  /// Instant::max() if empty.
  Instant next_departure() const {
    return heap_.empty() ? Instant::max() : heap_.front().departure;
  }

  /// Departure of the last packet to leave; Instant::min() if empty. Looks at every packet.
  Instant last_departure() const;

  /// Takes out the first, into `ready`, if it is due by `now`; else returns false.
  bool pop(Instant now, Ready& ready);

  std::size_t size() const { return heap_.size(); }
  /// Payload of those in it.
  std::size_t bytes() const { return bytes_; }

 private:
  // Small, so that reordering the heap moves no packets.
  struct Key {
    Instant departure;
    std::uint64_t number;
    std::size_t place;
  };
  struct Later {
    bool operator()(const Key& a, const Key& b) const {
      return a.departure != b.departure ? a.departure > b.departure : a.number > b.number;
    }
  };

  std::vector<Key> heap_;  // earliest departure first
  std::vector<Ready> places_;
  std::vector<std::size_t> free_;
  std::uint64_t pushed_ = 0;
  std::size_t bytes_ = 0;
};

}  // namespace tether
