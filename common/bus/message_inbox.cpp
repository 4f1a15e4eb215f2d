#include "common/bus/message_inbox.hpp"

#include <algorithm>
#include <utility>

namespace tether {

void MessageInbox::add(const Message& message) {
  auto found = channels_.find(message.channel);
  if (found == channels_.end()) {
    found = channels_.emplace(std::string(message.channel), std::deque<Entry>{}).first;
  }
  std::deque<Entry>& waiting = found->second;
  waiting.push_back({digest_of(message.bytes), {message.bytes.begin(), message.bytes.end()}});
  ++size_;
  if (waiting.size() > kMost) {
    waiting.pop_front();
    --size_;
  }
}

std::optional<MessageInbox::Bytes> MessageInbox::take(std::string_view channel,
                                                      const MessageDigest& digest) {
  const auto found = channels_.find(channel);
  if (found == channels_.end()) return std::nullopt;
  std::deque<Entry>& waiting = found->second;
  const auto entry = std::find_if(waiting.begin(), waiting.end(),
                                  [&](const Entry& e) { return e.digest == digest; });
  if (entry == waiting.end()) return std::nullopt;
  Bytes bytes = std::move(entry->bytes);
  waiting.erase(entry);
  --size_;
  return bytes;
}

std::map<std::string, std::size_t> MessageInbox::sizes() const {
  std::map<std::string, std::size_t> sizes;
  for (const auto& [channel, waiting] : channels_) {
    if (!waiting.empty()) sizes[channel] = waiting.size();
  }
  return sizes;
}

}  // namespace tether
