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

}  // namespace tether
