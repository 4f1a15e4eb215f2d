#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/node/bus.hpp"

namespace tether {

/// One of a message's datagrams: `header`, then `payload`.
using SendDatagram = std::function<void(std::span<const std::uint8_t> header,
                                        std::span<const std::uint8_t> payload)>;

/// LCM's longest channel name.
inline constexpr std::size_t kMaxChannelBytes = 63;

/// Hands over the datagrams of a message as LCM sends them (LCM documentation, "UDP Multicast
/// Protocol Description"): one if channel and bytes fit in 65499 bytes, else fragments. `number`:
/// one more for each message of a sender. False, and nothing is handed over, if the channel's name
/// is longer than kMaxChannelBytes or there were more than 65535 fragments.
bool make_lcm_datagrams(std::uint32_t number, std::string_view channel,
                        std::span<const std::uint8_t> bytes, const SendDatagram& send);

/// Puts messages together from LCM's datagrams. It copes with any input: fragments may come in any
/// order, twice or not at all, and anything that is not LCM's is counted and left.
class LcmAssembler {
 public:
  struct Counters {
    std::int64_t malformed = 0;   ///< datagrams that are not LCM's, or contradict earlier fragments
    std::int64_t incomplete = 0;  ///< messages given up, because newer fragments needed the room
  };

  /// The most bytes of one message, and of all incomplete messages together.
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 26;
  /// The most incomplete messages that are kept.
  static constexpr std::size_t kMaxPending = 256;

  /// The message that this datagram completes, valid until the next call. `sender` tells the
  /// senders apart: messages of different senders may have the same number.
  std::optional<Message> take(std::uint64_t sender, std::span<const std::uint8_t> datagram);

  const Counters& counters() const { return counters_; }

 private:
  using Key = std::pair<std::uint64_t, std::uint32_t>;  // sender, number
  struct Partial {
    std::optional<std::string> channel;  // comes with the first fragment
    std::vector<std::uint8_t> bytes;
    std::vector<bool> has;  // fragments
    std::size_t missing;
    std::list<Key>::iterator age;
  };
  struct Fragment;

  std::optional<Message> take_short(std::uint64_t sender, std::span<const std::uint8_t> datagram);
  std::optional<Message> take_fragment(std::uint64_t sender,
                                       std::span<const std::uint8_t> datagram);
  Partial& partial(const Key& key, const Fragment& fragment);
  void give_up(std::map<Key, Partial>::iterator found);
  std::optional<Message> malformed();

  std::map<Key, Partial> pending_;
  std::list<Key> ages_;  // oldest first
  std::size_t pending_bytes_ = 0;
  std::string channel_;              // channel of the message last completed from fragments
  std::vector<std::uint8_t> bytes_;  // the same
  Counters counters_;
};

}  // namespace tether
