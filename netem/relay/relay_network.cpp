#include "netem/relay/relay_network.hpp"

#include <utility>

#include "common/lcm/lcm_datagrams.hpp"

namespace tether {
namespace {

/// A flood of names must not fill the memory.
constexpr std::size_t kKnownChannels = 10'000;

bool can_be_a_channel(const std::string& name) {
  return !name.empty() && name.size() <= kMaxChannelBytes && name.find('\0') == std::string::npos;
}

}  // namespace

void RelayNetwork::add_rule(const RelayRule& rule, std::size_t link, std::size_t destination) {
  rules_.push_back({ChannelMap(rule), link, destination});
}

void RelayNetwork::listen(Take take) {
  if (rules_.empty()) return;
  bus_->subscribe(".*", kDeepQueue, [this, take = std::move(take)](const Message& m) {
    const Routes& to = routes(m.channel);
    if (!to.empty()) take(m, to);
  });
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

}  // namespace tether
