#include "netem/relay/relay_node.hpp"

#include <algorithm>
#include <cctype>
#include <utility>

#include "common/bus/channel_names.hpp"
#include "common/bus/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

std::string report_channel(std::string link) {
  std::transform(link.begin(), link.end(), link.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return "NET/" + link;
}

}  // namespace

RelayNode::RelayNode(const NetemSettings& settings, const std::vector<RelayRule>& rules,
                     EventLoop& loop, const std::string& own_url, const NetworkAt& network_at)
    : loop_(loop),
      counters_(loop, networks_[add_network(own_url, network_at)].bus(), "netem",
                ChannelNames(settings.get<VehicleSettings>().name).net_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  add_links(settings, rules);
  for (const RelayRule& rule : rules) {
    const std::size_t from = add_network(rule.source_url, network_at);
    const std::size_t to = add_network(rule.destination_url, network_at);
    networks_[from].add_rule(rule, link_numbers_.at(rule.link), to);
  }
  for (RelayNetwork& network : networks_) {
    network.listen([this](const Message& message, const std::vector<Route>& routes) {
      take(message, routes);
    });
  }
}

std::size_t RelayNode::add_network(const std::string& url, const NetworkAt& network_at) {
  const auto [found, added] = network_numbers_.try_emplace(url, networks_.size());
  if (added) networks_.emplace_back(found->second, network_at(url));
  return found->second;
}

void RelayNode::add_links(const NetemSettings& settings, const std::vector<RelayRule>& rules) {
  const ChannelUse use = use_of(rules);
  ChannelModels models = make_models(settings, use.links);
  std::vector<Link> links = make_links(settings, models, use.links);
  std::vector<RunningLink*> running;
  for (std::size_t i = 0; i < use.links.size(); ++i) {
    const std::string& name = use.links[i];
    link_numbers_[name] = i;
    running.push_back(&links_.emplace_back(
        name, std::move(links[i]), loop_, from_seconds(settings.get<RunSettings>().report_period_s),
        [this](const Packet& packet) {
          networks_[packet.destination].bus().publish(packet.channel, packet.bytes);
        },
        [this, channel = report_channel(name)](const link_report_t& report) {
          publish(networks_.front().bus(), channel, report);
        }));
  }
  settings_.emplace(settings, std::move(models), use, std::move(running), loop_,
                    std::vector<Bus*>{&networks_.front().bus()});
}

void RelayNode::take(const Message& message, const std::vector<Route>& routes) {
  for (const Route& route : routes) {
    ++heard_;
    if (route.channel.empty()) {
      ++refused_names_;
      continue;
    }
    links_[route.link].take(
        {route.channel, {message.bytes.begin(), message.bytes.end()}, route.destination});
  }
}

void RelayNode::finish() {
  for (RunningLink& link : links_) link.report();
  counters_.publish_now();
}

void RelayNode::list_counters(CounterList& out) const {
  for (const RunningLink& link : links_) link.list_counters(out);
  out.emplace_back("heard", heard_);
  out.emplace_back("names.refused", refused_names_);
  settings_->list_counters(out);
  for (const auto& [url, number] : network_numbers_) {
    CounterList of_network;
    networks_[number].bus().list_counters(of_network);
    for (auto& [name, value] : of_network) {
      out.emplace_back(network_address(url) + "." + name, value);
    }
  }
}

}  // namespace tether
