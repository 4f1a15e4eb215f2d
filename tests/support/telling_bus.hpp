#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "common/node/bus.hpp"

namespace tether::test {

/// A bus that tells who sent what it delivers, as UdpmBus does: `who` knows by the message.
class TellingBus final : public Bus {
 public:
  TellingBus(Bus& bus, std::function<std::uint64_t(const Message&)> who)
      : bus_(bus), who_(std::move(who)) {}

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override {
    bus_.publish(channel, bytes);
  }
  void subscribe(const std::string& channel_regex, int capacity, Handler handler) override {
    bus_.subscribe(channel_regex, capacity,
                   [this, handler = std::move(handler)](const Message& message) {
                     handler({message.channel, message.bytes, who_(message)});
                   });
  }

 private:
  Bus& bus_;
  std::function<std::uint64_t(const Message&)> who_;
};

/// Messages numbered 1000 are of 127.0.0.1:257, all others of 127.0.0.1:256. Bytes 16 to 23 of all
/// our types are seq.
inline std::uint64_t sender_by_number(const Message& message) {
  constexpr std::array<std::uint8_t, 8> k1000{0, 0, 0, 0, 0, 0, 3, 232};
  const bool other = message.bytes.size() >= 24 &&
                     std::equal(k1000.begin(), k1000.end(), message.bytes.begin() + 16);
  return other ? 0x0100007f'0101 : 0x0100007f'0001;
}

}  // namespace tether::test
