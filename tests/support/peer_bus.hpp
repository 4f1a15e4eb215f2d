#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "common/node/in_process_bus.hpp"

namespace tether::test {

/// One program's access to a network in virtual time: hears all but itself.
class PeerBus final : public Bus {
 public:
  /// Both must outlive the peer's last message.
  PeerBus(InProcessBus& network, EventLoop& loop) : network_(network), loop_(loop) {}

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override {
    // The network delivers in the order of publication, so that between these is what is published.
    loop_.at(loop_.now(), Priority::delivery, [this](Instant) { deaf_ = true; });
    network_.publish(channel, bytes);
    loop_.at(loop_.now(), Priority::delivery, [this](Instant) { deaf_ = false; });
  }

  bool hears_itself() const override { return false; }

  void subscribe(const std::string& channel_regex, int capacity, Handler handler) override {
    network_.subscribe(channel_regex, capacity,
                       [this, handler = std::move(handler)](const Message& message) {
                         if (!deaf_) handler(message);
                       });
  }

 private:
  InProcessBus& network_;
  EventLoop& loop_;
  bool deaf_ = false;
};

}  // namespace tether::test
