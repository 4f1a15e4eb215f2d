#pragma once

#include <cstdint>
#include <exception>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/message_lengths.hpp"

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

}  // namespace tether
