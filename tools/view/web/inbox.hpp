#pragma once

#include <cstdint>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "tools/view/session/hub.hpp"

namespace tether {

/// Messages of the program to the server's thread; filled by the one and emptied by the other,
/// neither of which waits for more than a copy. Bounded: what does not fit is dropped and counted.
class ViewInbox {
 public:
  struct Heard {
    std::size_t topic_begin = 0, topic_bytes = 0, data_bytes = 0;
    std::uint64_t time_ns = 0;
  };
  struct Json {
    DerivedChannels::Description channel;
    std::uint64_t time_ns = 0;
    std::string json;
  };
  struct Status {
    StatusLevel level;
    std::string text;
  };
  struct Time {
    std::uint64_t time_ns = 0;
  };
  using Item = std::variant<Heard, Json, std::vector<Parameter>, ViewAnswer, Status, Time>;

  struct Batch {
    std::vector<Item> items;
    std::vector<std::uint8_t> bytes;  ///< bytes of the received message
  };
  static constexpr std::size_t kMostBytes = std::size_t{16} << 20;
  static constexpr std::size_t kMostItems = 200'000;

  /// True if it was empty.
  bool hear(std::string_view topic, std::span<const std::uint8_t> data, std::uint64_t time_ns) {
    const std::lock_guard lock(mutex_);
    if (waiting_.items.size() >= kMostItems ||
        waiting_.bytes.size() + topic.size() + data.size() > kMostBytes) {
      ++dropped_;
      return false;
    }
    const bool was_empty = waiting_.items.empty();
    waiting_.items.emplace_back(Heard{waiting_.bytes.size(), topic.size(), data.size(), time_ns});
    waiting_.bytes.insert(waiting_.bytes.end(), topic.begin(), topic.end());
    waiting_.bytes.insert(waiting_.bytes.end(), data.begin(), data.end());
    return was_empty;
  }

  /// The same for what is rare.
  bool put(Item item) {
    const std::lock_guard lock(mutex_);
    if (waiting_.items.size() >= 2 * kMostItems) {
      ++dropped_;
      return false;
    }
    const bool was_empty = waiting_.items.empty();
    waiting_.items.push_back(std::move(item));
    return was_empty;
  }

  /// Exchanges what waits for `batch`, whose memory is used again.
  void take(Batch& batch) {
    batch.items.clear();
    batch.bytes.clear();
    const std::lock_guard lock(mutex_);
    std::swap(batch, waiting_);
  }

  bool empty() const {
    const std::lock_guard lock(mutex_);
    return waiting_.items.empty();
  }
  std::int64_t dropped() const {
    const std::lock_guard lock(mutex_);
    return dropped_;
  }

 private:
  mutable std::mutex mutex_;
  Batch waiting_;
  std::int64_t dropped_ = 0;
};

}  // namespace tether
