#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "common/bus.hpp"
#include "common/event_loop.hpp"
#include "netem/echo_filter.hpp"
#include "netem/relay_rule.hpp"

namespace tether {

/// Where a channel's messages go by one rule.
struct Route {
  std::size_t link = 0;
  std::size_t destination = 0;  ///< number of the network
  std::string channel;          ///< empty: no channel can have the name that the rule makes
};

/// One of the networks that a relay joins: publishes so that the relay will know its own messages,
/// and hands over everybody else's that a rule is about, each once, with its routes.
class RelayNetwork final : public Bus {
 public:
  /// `message` lives as long as the call.
  using Take = std::function<void(const Message& message, const std::vector<Route>& routes)>;

  /// All must outlive the network. `number`: of this network, for `echoes` and routes.
  RelayNetwork(std::size_t number, Bus& bus, EventLoop& loop, EchoFilter& echoes);

  /// Before listen().
  void add_rule(const RelayRule& rule, std::size_t link, std::size_t destination);
  /// Hears what the rules are about from now on; without rules, nothing.
  void listen(Take take);

  void publish(std::string_view channel, std::span<const std::uint8_t> bytes) override;
  void subscribe(const std::string& channel_regex, int queue_capacity, Handler handler) override;
  void list_counters(CounterList& out) const override { bus_.list_counters(out); }

 private:
  struct Rule {
    std::string pattern;
    ChannelMap names;
    std::size_t link;
    std::size_t destination;
  };
  using Routes = std::vector<Route>;

  const Routes& routes(std::string_view channel);
  Routes make_routes(std::string_view channel) const;
  /// One pattern for all rules, so that a message that several are about comes once.
  std::string joint_pattern() const;

  std::size_t number_;
  Bus& bus_;
  EventLoop& loop_;
  EchoFilter& echoes_;
  std::vector<Rule> rules_;
  std::map<std::string, Routes, std::less<>> known_;  // per channel
};

}  // namespace tether
