#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/bus/bus.hpp"
#include "netem/relay/relay_rule.hpp"

namespace tether {

/// Where a channel's messages go by one rule.
struct Route {
  std::size_t link = 0;
  std::size_t destination = 0;  ///< number of the network
  std::string channel;          ///< empty: no channel can have the name that the rule makes
};

/// One of the networks that a relay joins: hands over what others send and a rule is about, each
/// message once, with its routes.
class RelayNetwork {
 public:
  /// `message` lives as long as the call.
  using Take = std::function<void(const Message& message, const std::vector<Route>& routes)>;

  /// `bus` must not hear what it publishes itself. `number`: of this network, for routes.
  RelayNetwork(std::size_t number, std::unique_ptr<Bus> bus)
      : number_(number), bus_(std::move(bus)) {}

  /// Before listen().
  void add_rule(const RelayRule& rule, std::size_t link, std::size_t destination);
  /// Hears what the rules are about from now on; without rules, nothing.
  void listen(Take take);

  Bus& bus() { return *bus_; }
  const Bus& bus() const { return *bus_; }

 private:
  struct Rule {
    ChannelMap names;
    std::size_t link;
    std::size_t destination;
  };
  using Routes = std::vector<Route>;

  const Routes& routes(std::string_view channel);
  Routes make_routes(std::string_view channel) const;

  std::size_t number_;
  std::unique_ptr<Bus> bus_;
  std::vector<Rule> rules_;
  std::map<std::string, Routes, std::less<>> known_;  // per channel
};

}  // namespace tether
