#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

namespace tether {

/// Bytes that many clients are sent and none changes.
using SharedText = std::shared_ptr<const std::string>;

/// Series of messages to one client (Outgoing::series).
inline constexpr std::uint64_t kTimeSeries = 0;
inline std::uint64_t series_of(std::uint32_t subscription) {
  return std::uint64_t{1} + subscription;
}

/// One message to a client, as a WebSocket message.
struct Outgoing {
  bool is_text = false;
  std::vector<std::uint8_t> header;  ///< goes first; not of text
  SharedText payload;                ///< may be null: all is in the header
  /// Series of data: the newer message of a series replaces the older. Of messages of a
  /// channel, its subscription.
  std::uint64_t series = 0;

  std::size_t size_bytes() const { return header.size() + (payload ? payload->size() : 0); }
};

/// State of one client in the server: what it wants to hear, and what waits to be sent to it.
/// The queue is bounded, so that a client that does not read costs no more than that: of data, the
/// oldest are dropped and counted, but the newest of each series only if there is nothing else, so
/// that what is sent rarely arrives; text (which channels there are, values of parameters) never is
/// dropped, and a client with too much of it is to be cut off.
class Session {
 public:
  struct Limits {
    std::size_t data_bytes = std::size_t{2} << 20;
    std::size_t text_bytes = std::size_t{4} << 20;
    std::size_t subscriptions = 4096;
    std::size_t publications = 64;
  };
  Session() : Session(Limits{}) {}
  explicit Session(const Limits& limits) : limits_(limits) {}

  void push_text(SharedText text);
  void push_data(Outgoing message);
  /// The next to be sent, in the order of pushing; none if there is none.
  std::optional<Outgoing> next();
  bool idle() const { return texts_.empty() && data_.empty(); }

  /// Data messages that were not sent because the client reads too slowly.
  std::int64_t dropped() const { return dropped_; }
  /// The client has so much text to read that it will not.
  bool is_overwhelmed() const { return text_bytes_ > limits_.text_bytes; }

  const Limits& limits() const { return limits_; }

  // Kept by the hub.
  /// Channels of subscriptions, by the client's ids.
  std::map<std::uint32_t, std::uint32_t> channels;
  std::map<std::uint32_t, std::string> publications;  ///< topics, by the client's ids
  bool all_parameters = false;       ///< it wants to hear of each change of a parameter
  std::set<std::string> parameters;  ///< else of these

 private:
  struct Waiting {
    std::uint64_t place;
    Outgoing message;
  };
  void drop_one();
  void forget(std::uint64_t series);

  Limits limits_;
  std::deque<Waiting> texts_, data_;
  std::unordered_map<std::uint64_t, std::size_t> waiting_;  ///< index of waiting data, by series
  std::size_t text_bytes_ = 0, data_bytes_ = 0;
  std::uint64_t pushed_ = 0;
  std::int64_t dropped_ = 0;
};

}  // namespace tether
