#include "netem/relay/relay_rule.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/lcm/lcm_datagrams.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "netem/channel/settings.hpp"

namespace tether {
namespace {

constexpr char kExample[] = "udpm://239.255.76.67:7667?ttl=0:CAM_(.*) -> CAM_DELAYED_$1 via uplink";
constexpr char kSameName[] = "$&";

[[noreturn]] void refuse(const std::string& rule, const std::string& why) {
  throw UsageError(fmt::format("--rule \"{}\": {} (such as --rule '{}')", rule, why, kExample));
}

/// Runs `part` of the reading; its error becomes one of the rule.
template <class Part>
auto of_rule(const std::string& rule, Part part) {
  try {
    return part();
  } catch (const UsageError& error) {
    refuse(rule, error.what());
  }
}

/// One of the two sides of the arrow.
struct Side {
  std::string url;   ///< empty: not given
  std::string name;  ///< empty: not given
};

Side parse_side(const std::string& rule, const std::string& text) {
  const auto scheme = text.find("://");
  const bool has_url = scheme != std::string::npos && scheme > 0 &&
                       std::all_of(text.begin(), text.begin() + static_cast<long>(scheme),
                                   [](unsigned char c) { return std::isalnum(c) != 0; });
  if (!has_url) return {"", text};
  if (text.substr(0, scheme) != "udpm") {
    refuse(rule, fmt::format("\"{}\": of LCM's networks, rules can use udpm:// only", text));
  }
  const auto port = text.find(':', scheme + 3);
  const auto end = port == std::string::npos ? port : text.find(':', port + 1);
  return {of_rule(rule, [&] { return checked_lcm_url(text.substr(0, end)); }),
          end == std::string::npos ? "" : text.substr(end + 1)};
}

void check_link(const std::string& rule, const std::string& link, const NetemSettings& settings) {
  std::vector<std::string> names;
  const LinkConfig* found = nullptr;
  settings.get<ChannelSettings>().for_each_link(
      [&](const std::string& key, const LinkConfig& config) {
        names.push_back(key.starts_with("links.") ? key.substr(6) : key);
        if (names.back() == link) found = &config;
      });
  if (found == nullptr) {
    refuse(rule, fmt::format("no link \"{}\"; there are {}; others are tables of the scenario, "
                             "[channel.links.{}]",
                             link, fmt::join(names, ", "), link.empty() ? "NAME" : link));
  }
  const std::string why = why_not_by_rules(link, *found);
  if (!why.empty()) refuse(rule, why);
}

/// A channel that becomes itself would be heard, relayed, heard …
void check_loop(const std::string& text, const RelayRule& rule) {
  if (network_address(rule.source_url) != network_address(rule.destination_url)) return;
  const bool literal = rule.rename.find('$') == std::string::npos;
  if (rule.rename != kSameName && !(literal && ChannelMap(rule).map(rule.rename))) return;
  refuse(text, fmt::format("a loop: what leaves as \"{}\" on the same network is what the pattern "
                           "takes; give another network or another name",
                           rule.rename == kSameName ? rule.pattern : rule.rename));
}

RelayRule parse_rule(const std::string& text, const std::string& own_url,
                     const NetemSettings& settings) {
  const auto via = text.rfind(" via ");
  if (via == std::string::npos) refuse(text, "must end with \" via LINK\"");
  const auto sides = of_rule(text, [&] { return split_at_arrow(text.substr(0, via)); });
  if (!sides) refuse(text, "no arrow, -> or →");
  const auto& [left, right] = *sides;
  const Side from = parse_side(text, left);
  const Side to = parse_side(text, right);
  if (from.name.empty()) {
    refuse(text, "no channel pattern before the arrow; write URL:REGEX or REGEX");
  }
  if (to.name.empty() && to.url.empty()) {
    refuse(text, "nothing behind the arrow; write URL:NAME, NAME or URL");
  }
  RelayRule rule;
  rule.source_url = from.url.empty() ? own_url : from.url;
  rule.pattern = from.name;
  rule.destination_url = to.url.empty() ? own_url : to.url;
  rule.rename = to.name.empty() ? kSameName : to.name;
  rule.link = trimmed(text.substr(via + 5));
  if (rule.rename.find('$') == std::string::npos && rule.rename.size() > kMaxChannelBytes) {
    refuse(text, fmt::format("\"{}\" is too long for a channel: at most {} bytes", rule.rename,
                             kMaxChannelBytes));
  }
  of_rule(text, [&] { Pattern(rule.pattern).check_replacement(rule.rename); });
  check_link(text, rule.link, settings);
  check_loop(text, rule);
  return rule;
}

/// LCM 1.3.1 hears every group of a port, and one network cannot be opened in two ways.
void check_networks(const std::string& text, const RelayRule& rule,
                    std::vector<std::string>& urls) {
  for (const std::string& url : {rule.source_url, rule.destination_url}) {
    for (const std::string& other : urls) {
      if (other == url) continue;
      const std::string here = network_address(url), there = network_address(other);
      if (here == there) {
        refuse(text, fmt::format("{} and {} are the same network: write it the same way everywhere",
                                 url, other));
      }
      if (here.substr(here.find(':')) == there.substr(there.find(':'))) {
        refuse(text, fmt::format("{} and {} have the same port: LCM 1.3.1 cannot tell groups on "
                                 "one port apart",
                                 url, other));
      }
    }
    urls.push_back(url);
  }
}

}  // namespace

std::string network_address(const std::string& url) {
  const auto begin = url.find("://");
  return begin == std::string::npos ? url : url.substr(begin + 3, url.find('?') - begin - 3);
}

std::vector<RelayRule> parse_relay_rules(const std::vector<std::string>& texts,
                                         const std::string& own_url,
                                         const NetemSettings& settings) {
  const std::string own = checked_lcm_url(own_url);
  if (multicast_group(own).empty()) {
    throw UsageError(
        fmt::format("--rule: of LCM's networks, rules can use udpm:// only, not {}", own));
  }
  std::vector<std::string> urls{own};
  std::vector<RelayRule> rules;
  for (const std::string& text : texts) {
    rules.push_back(parse_rule(text, own, settings));
    check_networks(text, rules.back(), urls);
  }
  return rules;
}

ChannelUse use_of(const std::vector<RelayRule>& rules) {
  ChannelUse use{{}, true};
  for (const RelayRule& rule : rules) {
    const bool known = std::find(use.links.begin(), use.links.end(), rule.link) != use.links.end();
    if (!known) use.links.push_back(rule.link);
  }
  return use;
}

std::string to_text(const RelayRule& rule) {
  const std::string name = rule.rename == kSameName ? "as it is" : "as \"" + rule.rename + "\"";
  return fmt::format("\"{}\" on {} → {} on {}, via {}", rule.pattern,
                     network_address(rule.source_url), name, network_address(rule.destination_url),
                     rule.link);
}

ChannelMap::ChannelMap(const RelayRule& rule) : pattern_(rule.pattern), rename_(rule.rename) {}

std::optional<std::string> ChannelMap::map(std::string_view channel) const {
  return pattern_.replaced(channel, rename_);
}

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
