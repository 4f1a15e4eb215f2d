#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/lcm/message_digest.hpp"
#include "common/node/bus.hpp"

namespace tether {

/// Keeps messages that have come until they are asked for. A message is found by its channel and
/// digest. One that is never asked for (a second copy, or another program's) only takes room until
/// newer ones need it.
class MessageInbox {
 public:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr std::size_t kMost = 4096;

  void add(const Message& message);
  /// Takes out one message with this digest. `key`: the run's, in all calls the same.
  std::optional<Bytes> take(std::string_view channel, const MessageDigest& digest,
                            const DigestKey& key);
  std::size_t size() const { return size_; }
  /// The number of messages kept, by channel; channels without any are left out.
  std::map<std::string, std::size_t> sizes() const;
  void for_each(
      const std::function<void(const std::string& channel, const Bytes& bytes)>& use) const;

 private:
  struct Entry {
    Bytes bytes;
    std::optional<MessageDigest> digest{};  ///< once it was asked for
  };
  std::map<std::string, std::deque<Entry>, std::less<>> channels_;  // each: oldest first
  std::size_t size_ = 0;
};

}  // namespace tether
