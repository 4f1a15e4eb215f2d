#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <utility>

#include "netem/packet_queue.hpp"

namespace tether {

/// Packets that a relay has heard and not yet dealt with: LCM's own queue drops without a word, so
/// it is emptied into this one first. Bounded; counts what there was no room for.
class RelayIntake {
 public:
  struct Entry {
    std::size_t link;
    Packet packet;
  };

  RelayIntake(std::size_t packets, std::size_t bytes) : max_packets_(packets), max_bytes_(bytes) {}

  /// False if there was no room.
  bool push(Entry entry) {
    const std::size_t bytes = bytes_ + entry.packet.bytes.size();
    if (entries_.size() >= max_packets_ || bytes > max_bytes_) {
      ++dropped_;
      return false;
    }
    bytes_ = bytes;
    entries_.push_back(std::move(entry));
    return true;
  }

  /// Not on an empty one.
  Entry pop() {
    Entry entry = std::move(entries_.front());
    entries_.pop_front();
    bytes_ -= entry.packet.bytes.size();
    return entry;
  }

  bool empty() const { return entries_.empty(); }
  std::size_t size() const { return entries_.size(); }
  std::int64_t dropped() const { return dropped_; }

 private:
  std::size_t max_packets_;
  std::size_t max_bytes_;
  std::size_t bytes_ = 0;
  std::deque<Entry> entries_;
  std::int64_t dropped_ = 0;
};

}  // namespace tether
