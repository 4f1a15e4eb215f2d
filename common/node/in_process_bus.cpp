#include "common/node/in_process_bus.hpp"

#include <algorithm>
#include <cctype>
#include <optional>
#include <utility>

#include "common/base/pattern.hpp"

namespace tether {

struct alignas(64) InProcessBus::Subscription {
  Handler handler;
  std::size_t number;
  std::optional<Pattern> pattern;  ///< none: of the one channel of that name
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

void InProcessBus::publish(std::string_view name, std::span<const std::uint8_t> bytes) {
  const Channel& to = channel(name);
  if (to.receivers.empty()) return;
  loop_.at(loop_.now(), Priority::delivery,
           [&to, data = std::vector<std::uint8_t>(bytes.begin(), bytes.end())](Instant) {
             for (const Subscription* s : to.receivers) s->handler({to.name, data});
           });
}

void InProcessBus::subscribe(const std::string& channel_regex, int, Handler handler) {
  subscriptions_.push_back(
      std::make_unique<Subscription>(Subscription{std::move(handler), subscriptions_.size(), {}}));
  Subscription* made = subscriptions_.back().get();
  if (is_a_name(channel_regex)) {
    named_[channel_regex].push_back(made);
    if (const auto known = channels_.find(channel_regex); known != channels_.end())
      known->second->receivers.push_back(made);
    return;
  }
  made->pattern.emplace(channel_regex);
  patterns_.push_back(made);
  for (auto& [name, channel] : channels_) {
    if (made->pattern->matches(name)) channel->receivers.push_back(made);
  }
}

const InProcessBus::Channel& InProcessBus::channel(std::string_view name) {
  const Channel*& recent = recent_[Hash{}(name) % recent_.size()];
  if (recent == nullptr || recent->name != name) recent = &find_or_make(name);
  return *recent;
}

const InProcessBus::Channel& InProcessBus::find_or_make(std::string_view name) {
  const auto known = channels_.find(name);
  if (known != channels_.end()) return *known->second;
  Receivers found;
  if (const auto named = named_.find(name); named != named_.end()) found = named->second;
  for (Subscription* s : patterns_) {
    if (s->pattern->matches(name)) found.push_back(s);
  }
  std::sort(found.begin(), found.end(),
            [](const Subscription* a, const Subscription* b) { return a->number < b->number; });
  auto made = std::make_unique<Channel>(Channel{std::string(name), std::move(found)});
  return *channels_.emplace(name, std::move(made)).first->second;
}

}  // namespace tether
