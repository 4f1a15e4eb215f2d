#include "netem/echo_filter.hpp"

#include <functional>
#include <string_view>

namespace tether {

EchoFilter::EchoFilter(Duration memory, std::size_t capacity)
    : memory_(memory), capacity_(capacity) {}

EchoFilter::Key EchoFilter::key(std::size_t network, const Message& message) {
  const std::hash<std::string_view> hash;
  const std::string_view bytes(reinterpret_cast<const char*>(message.bytes.data()),
                               message.bytes.size());
  return {network, hash(message.channel), hash(bytes), bytes.size()};
}

void EchoFilter::published(Instant now, std::size_t network, const Message& message) {
  forget_old(now);
  if (records_.size() >= capacity_ && !forget_oldest()) ++counters_.forgotten;
  const auto count = counts_.try_emplace(key(network, message)).first;
  ++count->second.waiting;
  ++waiting_;
  records_.push_back({now + memory_, count});
}

bool EchoFilter::heard(Instant now, std::size_t network, const Message& message) {
  forget_old(now);
  if (waiting_ == 0) return false;
  const auto found = counts_.find(key(network, message));
  if (found == counts_.end() || found->second.waiting == 0) return false;
  --found->second.waiting;
  ++found->second.heard;
  --waiting_;
  ++counters_.recognised;
  while (!records_.empty() && records_.front().count->second.heard > 0) forget_oldest();
  return true;
}

bool EchoFilter::forget_oldest() {
  const auto count = records_.front().count;
  records_.pop_front();
  const bool heard = count->second.heard > 0;
  --(heard ? count->second.heard : count->second.waiting);
  if (!heard) --waiting_;
  if (count->second.heard == 0 && count->second.waiting == 0) counts_.erase(count);
  return heard;
}

void EchoFilter::forget_old(Instant now) {
  while (!records_.empty() && records_.front().end <= now) {
    if (!forget_oldest()) ++counters_.unheard;
  }
}

}  // namespace tether
