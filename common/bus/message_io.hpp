#pragma once

#include <cstdint>
#include <exception>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/counters.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/message_lengths.hpp"
#include "common/loop/event_loop.hpp"

namespace tether {

/// Encodes and publishes one LCM message.
template <class LcmType>
void publish(Bus& bus, std::string_view channel, const LcmType& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  bus.publish(channel, bytes);
}

/// Decodes one LCM message; false for another type, a wrong length or impossible array sizes.
/// Never throws: generated code does, for bad array and string lengths (and does worse for some:
/// see message_lengths.hpp).
template <class LcmType>
bool decode(std::span<const std::uint8_t> bytes, LcmType& message) noexcept {
  constexpr std::size_t kMaxBytes = 1 << 16;  // most of ours are below 1 KiB
  if (bytes.size() > kMaxBytes || !lengths_fit<LcmType>(bytes)) return false;
  try {
    const int size = static_cast<int>(bytes.size());
    return message.decode(bytes.data(), 0, size) == size;
  } catch (const std::exception&) {
    return false;
  }
}

/// Subscribes to one LCM type. What cannot be decoded is counted and goes no further.
template <class LcmType, class Function>
void subscribe(Bus& bus, const std::string& channel, int queue_capacity, std::int64_t& undecodable,
               Function function) {
  bus.subscribe(channel, queue_capacity,
                [&undecodable, function = std::move(function)](const Message& raw) {
                  LcmType message{};
                  if (decode(raw.bytes, message)) {
                    function(message);
                  } else {
                    ++undecodable;
                  }
                });
}

/// A message that a subscriber did not accept.
struct Rejected {
  std::int64_t undecodable = 0;
  std::int64_t other_run = 0;

  /// Appends "<prefix>.undecodable" and "<prefix>.other_run".
  void list(const std::string& prefix, CounterList& out) const {
    out.emplace_back(prefix + ".undecodable", undecodable);
    out.emplace_back(prefix + ".other_run", other_run);
  }
};

/// The same for messages that say which run they are of: those of other runs go no further either.
template <class LcmType, class Function>
void subscribe_in_run(Bus& bus, const EventLoop& loop, const std::string& channel,
                      int queue_capacity, Rejected& rejected, Function function) {
  subscribe<LcmType>(bus, channel, queue_capacity, rejected.undecodable,
                     [&loop, &rejected, function = std::move(function)](const LcmType& message) {
                       if (message.run == loop.run_id()) {
                         function(message);
                       } else {
                         ++rejected.other_run;
                       }
                     });
}

}  // namespace tether
