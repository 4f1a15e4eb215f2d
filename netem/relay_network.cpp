#include "netem/relay_network.hpp"

#include <lcm/lcm.h>

#include <algorithm>
#include <utility>

#include "common/pattern.hpp"

namespace tether {
namespace {

/// Whoever floods the network with names fills no memory.
constexpr std::size_t kKnownChannels = 10'000;

bool can_be_a_channel(const std::string& name) {
  return !name.empty() && name.size() <= LCM_MAX_CHANNEL_NAME_LENGTH &&
         name.find('\0') == std::string::npos;
}

}  // namespace

RelayNetwork::RelayNetwork(std::size_t number, Bus& bus, EventLoop& loop, EchoFilter& echoes)
    : number_(number), bus_(bus), loop_(loop), echoes_(echoes) {}

void RelayNetwork::add_rule(const RelayRule& rule, std::size_t link, std::size_t destination) {
  rules_.push_back({rule.pattern, ChannelMap(rule), link, destination});
}

void RelayNetwork::listen(Take take) {
  if (rules_.empty()) return;
  bus_.subscribe(joint_pattern(), kDeepQueue, [this, take = std::move(take)](const Message& m) {
    const Routes& to = routes(m.channel);
    if (!to.empty() && !echoes_.heard(loop_.now(), number_, m)) take(m, to);
  });
}

void RelayNetwork::publish(std::string_view channel, std::span<const std::uint8_t> bytes) {
  if (!rules_.empty() && !routes(channel).empty()) {
    echoes_.published(loop_.now(), number_, {channel, bytes});
  }
  bus_.publish(channel, bytes);
}

void RelayNetwork::subscribe(const std::string& channel_regex, int queue_capacity,
                             Handler handler) {
  bus_.subscribe(channel_regex, queue_capacity, std::move(handler));
}

const RelayNetwork::Routes& RelayNetwork::routes(std::string_view channel) {
  const auto found = known_.find(channel);
  if (found != known_.end()) return found->second;
  if (known_.size() >= kKnownChannels) known_.clear();
  return known_.emplace(std::string(channel), make_routes(channel)).first->second;
}

RelayNetwork::Routes RelayNetwork::make_routes(std::string_view channel) const {
  Routes made;
  for (const Rule& rule : rules_) {
    std::optional<std::string> name = rule.names.map(channel);
    if (!name) continue;
    const bool unchanged = rule.destination == number_ && *name == channel;
    if (unchanged || !can_be_a_channel(*name)) name->clear();
    made.push_back({rule.link, rule.destination, *std::move(name)});
  }
  return made;
}

std::string RelayNetwork::joint_pattern() const {
  // LCM's expressions are not ECMAScript's, and one that it cannot compile crashes it. Of escapes
  // and classes, only those that both have go to LCM; references break in a joint pattern.
  static const Pattern kCommon(
      R"((?:[^\\\[]|\\[dDwWsSbB]|\\[^A-Za-z0-9]|\[\^?[^\]\\^][^\]\\]*\])*)");
  std::string joint;
  for (const Rule& rule : rules_) {
    if (!kCommon.matches(rule.pattern)) return ".*";
    joint += (joint.empty() ? "(?:" : "|(?:") + rule.pattern + ")";
  }
  return joint;
}

}  // namespace tether
