#include "common/bus/in_process_bus.hpp"

#include <utility>

#include "common/base/pattern.hpp"

namespace tether {

struct InProcessBus::Subscription {
  Pattern channel;
  Handler handler;
};

InProcessBus::InProcessBus(EventLoop& loop) : loop_(loop) {}

InProcessBus::~InProcessBus() = default;

void InProcessBus::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  if (receivers(channel).empty()) return;
  loop_.at(loop_.now(), Priority::delivery,
           [this, name = std::string(channel),
            data = std::vector<std::uint8_t>(bytes.begin(), bytes.end())](Instant) {
             for (Subscription* s : receivers(name)) s->handler({name, data});
           });
}

void InProcessBus::subscribe(const std::string& channel_regex, int, Handler handler) {
  subscriptions_.push_back(
      std::make_unique<Subscription>(Subscription{Pattern(channel_regex), std::move(handler)}));
  receivers_.clear();
}

const InProcessBus::Receivers& InProcessBus::receivers(std::string_view channel) {
  const auto known = receivers_.find(channel);
  if (known != receivers_.end()) return known->second;
  Receivers found;
  for (const auto& s : subscriptions_) {
    if (s->channel.matches(channel)) found.push_back(s.get());
  }
  return receivers_.emplace(std::string(channel), std::move(found)).first->second;
}

}  // namespace tether
