#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/pattern.hpp"
#include "common/node/bus.hpp"
#include "common/node/counter_reporter.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/node.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/channel/use.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/relay/running_link.hpp"

namespace tether {

/// Rule of tether-netem for messages of other programs, one `--rule`:
///
///     [SRC_URL:]REGEX → [DST_URL:]RENAME via LINK        (or ->)
///
/// Whatever appears on SRC_URL under a channel that REGEX matches as a whole
/// (common/base/pattern.hpp) leaves on DST_URL as RENAME ($1 … for what the groups matched, $& for
/// all) when it has passed LINK. Without a URL: the relay's own network. Without RENAME (DST_URL
/// alone): under the same name.
///
/// A part that begins with "udpm://" is a URL up to its second colon, the one before the port being
/// the first; everything behind it is the pattern, colons too. The arrow stands there once.
struct RelayRule {
  std::string source_url;  ///< a URL in the form of checked_lcm_url(), here and below
  std::string pattern;
  std::string destination_url;
  std::string rename;  ///< "$&": the same name
  std::string link;    ///< "uplink", "downlink" or one of [channel.links]
};

/// Reads rules for a relay on `own_url`. Throws UsageError, one line that names the rule, for what
/// does not follow the grammar above; for links that `scenario` does not have, or whose model needs
/// the vehicle's position; for a rule that turns a network's channel into itself; and for networks
/// that LCM cannot tell apart.
std::vector<RelayRule> parse_relay_rules(const std::vector<std::string>& texts,
                                         const std::string& own_url, const NetemSettings& settings);

/// The links that the rules use, in their order.
ChannelUse use_of(const std::vector<RelayRule>& rules);

/// The rule as it was understood, on a line.
std::string to_text(const RelayRule& rule);

/// "239.255.76.67:7667": what tells LCM networks apart.
std::string network_address(const std::string& url);

/// Mapping of channel names by a rule.
class ChannelMap {
 public:
  explicit ChannelMap(const RelayRule& rule);

  /// The name under which messages of `channel` leave; nullopt if the rule is not about them.
  std::optional<std::string> map(std::string_view channel) const;

 private:
  Pattern pattern_;
  std::string rename_;
};

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

/// The relay for any LCM traffic: carries what the rules say through the scenario's links, as raw
/// bytes. Never takes what it has published itself. Reports each link that a rule names on NET/LINK
/// (in capitals) and its counters on NET/COUNTERS, on its own network, every run.report_period_s.
/// There it also takes other settings for these links from NET/SET, answers on NET/SETTINGS, and
/// publishes those of channel.change, at their times since its start.
///
/// heard = names.refused + all links' offered (without their copies), always; "heard" counts a
/// message once for each rule that is about it.
class RelayNode final : public Node {
 public:
  /// Opens the network of a URL, as a bus that does not hear what it publishes itself. Asked once
  /// for each.
  using NetworkAt = std::function<std::unique_ptr<Bus>(const std::string& url)>;

  /// `own_url`: as checked_lcm_url() gives it. `rules`: of parse_relay_rules().
  RelayNode(const NetemSettings& settings, const std::vector<RelayRule>& rules, EventLoop& loop,
            const std::string& own_url, const NetworkAt& network_at);

  /// Publishes the final reports.
  void finish() override;

  /// One that a rule names.
  const Link& link(const std::string& name) const { return links_[link_numbers_.at(name)].link(); }

 private:
  std::size_t add_network(const std::string& url, const NetworkAt& network_at);
  void add_links(const NetemSettings& settings, const std::vector<RelayRule>& rules);
  void take(const Message& message, const std::vector<Route>& routes);
  void list_counters(CounterList& out) const;

  EventLoop& loop_;
  std::int64_t heard_ = 0;
  std::int64_t refused_names_ = 0;
  std::map<std::string, std::size_t> network_numbers_;  // by URL
  std::deque<RelayNetwork> networks_;                   // the first is the relay's own
  std::map<std::string, std::size_t> link_numbers_;
  std::deque<RunningLink> links_;
  std::optional<LiveSettings> settings_;  // set as soon as there are links
  CounterReporter counters_;
};

}  // namespace tether
