#include "common/lcm/message_inbox.hpp"

#include <algorithm>
#include <utility>

namespace tether {

void MessageInbox::add(const Message& message) {
  auto found = channels_.find(message.channel);
  if (found == channels_.end()) {
    found = channels_.emplace(std::string(message.channel), std::deque<Entry>{}).first;
  }
  std::deque<Entry>& waiting = found->second;
  waiting.push_back({{message.bytes.begin(), message.bytes.end()}});
  ++size_;
  if (waiting.size() > kMost) {
    waiting.pop_front();
    --size_;
  }
}

std::optional<MessageInbox::Bytes> MessageInbox::take(std::string_view channel,
                                                      const MessageDigest& digest,
                                                      const DigestKey& key) {
  const auto found = channels_.find(channel);
  if (found == channels_.end()) return std::nullopt;
  std::deque<Entry>& waiting = found->second;
  const auto entry = std::find_if(waiting.begin(), waiting.end(), [&](Entry& e) {
    if (static_cast<std::int64_t>(e.bytes.size()) != digest.size) return false;
    if (!e.digest) e.digest = digest_of(e.bytes, key);
    return e.digest == digest;
  });
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

void MessageInbox::for_each(
    const std::function<void(const std::string& channel, const Bytes& bytes)>& use) const {
  for (const auto& [channel, waiting] : channels_) {
    for (const Entry& entry : waiting) use(channel, entry.bytes);
  }
}

}  // namespace tether
