#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/counter_reporter.hpp"
#include "common/loop/event_loop.hpp"
#include "common/loop/node.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/relay/relay_network.hpp"
#include "netem/relay/relay_rule.hpp"
#include "netem/relay/running_link.hpp"

namespace tether {

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
