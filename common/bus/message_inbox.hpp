#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/message_digest.hpp"

namespace tether {

/// Keeps messages that have come until they are asked for. A message is found by its channel and
/// bytes. One that nobody asks for (a second copy, or somebody else's) only takes room until newer
/// ones need it.
class MessageInbox {
 public:
  using Bytes = std::vector<std::uint8_t>;
  static constexpr std::size_t kMost = 4096;

  void add(const Message& message);
  /// Takes out one message with these bytes.
  std::optional<Bytes> take(std::string_view channel, const MessageDigest& digest);
  std::size_t size() const { return size_; }
  /// The number of messages kept, by channel; channels without any are left out.
  std::map<std::string, std::size_t> sizes() const;

 private:
  struct Entry {
    MessageDigest digest;
    Bytes bytes;
  };
  std::map<std::string, std::deque<Entry>, std::less<>> channels_;  // each: oldest first
  std::size_t size_ = 0;
};

}  // namespace tether
