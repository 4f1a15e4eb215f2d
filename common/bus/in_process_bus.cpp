#include "common/bus/in_process_bus.hpp"

#include <algorithm>
#include <cctype>
#include <utility>

#include "common/base/pattern.hpp"

namespace tether {

struct InProcessBus::Subscription {
  std::size_t number;
  Pattern channel;
  Handler handler;
};

namespace {

/// Most are: only that one channel matches, and a fleet has thousands.
bool is_a_name(const std::string& regex) {
  return std::all_of(regex.begin(), regex.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '/' || c == '_' || c == '-';
  });
}

}  // namespace

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
  subscriptions_.push_back(std::make_unique<Subscription>(
      Subscription{subscriptions_.size(), Pattern(channel_regex), std::move(handler)}));
  (is_a_name(channel_regex) ? named_[channel_regex] : patterns_)
      .push_back(subscriptions_.back().get());
  receivers_.clear();
}

const InProcessBus::Receivers& InProcessBus::receivers(std::string_view channel) {
  const auto known = receivers_.find(channel);
  if (known != receivers_.end()) return known->second;
  Receivers found;
  if (const auto named = named_.find(channel); named != named_.end()) found = named->second;
  for (Subscription* s : patterns_) {
    if (s->channel.matches(channel)) found.push_back(s);
  }
  std::sort(found.begin(), found.end(),
            [](const Subscription* a, const Subscription* b) { return a->number < b->number; });
  return receivers_.emplace(std::string(channel), std::move(found)).first->second;
}

}  // namespace tether
