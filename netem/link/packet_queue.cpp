#include "netem/link/packet_queue.hpp"

#include <algorithm>
#include <utility>

namespace tether {

void PacketQueue::push(Instant arrival, Instant departure, Packet&& packet) {
  bytes_ += packet.bytes.size();
  std::size_t place = places_.size();
  if (free_.empty()) {
    places_.push_back({arrival, std::move(packet)});
  } else {
    place = free_.back();
    free_.pop_back();
    places_[place].arrival = arrival;
    places_[place].packet = std::move(packet);
  }
  heap_.push_back({departure, pushed_++, place});
  std::push_heap(heap_.begin(), heap_.end(), Later{});
}

Instant PacketQueue::last_departure() const {
  Instant last = Instant::min();
  for (const Key& key : heap_) last = std::max(last, key.departure);
  return last;
}

bool PacketQueue::pop(Instant now, Ready& ready) {
  if (heap_.empty() || heap_.front().departure > now) return false;
  std::pop_heap(heap_.begin(), heap_.end(), Later{});
  const std::size_t place = heap_.back().place;
  heap_.pop_back();
  free_.push_back(place);
  ready.arrival = places_[place].arrival;
  ready.packet = std::move(places_[place].packet);
  bytes_ -= ready.packet.bytes.size();
  return true;
}

}  // namespace tether
