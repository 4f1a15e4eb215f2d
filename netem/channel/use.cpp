#include "netem/channel/use.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/scenario/loader.hpp"
#include "netem/models/kinds.hpp"

namespace tether {
namespace {

const std::string kChannel = "channel.";

}  // namespace

/// `key` has its "channel.".
bool ChannelUse::covers(const std::string& key) const {
  if (key == kChannel + "shared_state") {
    return covers(kChannel + "uplink.") || covers(kChannel + "downlink.");
  }
  return std::any_of(links.begin(), links.end(), [&key](const std::string& link) {
    return key.starts_with(kChannel + link + ".") ||
           key.starts_with(kChannel + "links." + link + ".");
  });
}

void ChannelUse::check(const std::string& setting) const {
  const std::string given = std::string(trimmed(setting.substr(0, setting.find('='))));
  const std::string key = given.starts_with(kChannel) ? given : kChannel + given;
  if (key == kChannel) return;  // no key at all: for others to refuse
  const auto keys = ScenarioSchema::all()->keys_meant_by(key);
  if (std::any_of(keys.begin(), keys.end(), [&](const auto& k) { return covers(k); })) {
    return;
  }
  throw UsageError(fmt::format("{} has no effect: {} {}", setting,
                               by_rules ? "the rules use no link but" : "the relay has no link but",
                               fmt::join(links, ", ")));
}

void ChannelUse::check_models(const ChannelSettings& channel) const {
  if (!by_rules) return;
  for (const std::string& name : links) {
    const std::string why = why_not_by_rules(name, link_config(channel, name));
    if (!why.empty()) throw UsageError(why);
  }
}

std::vector<ChannelSetting> ChannelUse::select(std::vector<ChannelSetting> settings) const {
  std::erase_if(settings,
                [&](const ChannelSetting& setting) { return !covers(kChannel + setting.key); });
  return settings;
}

void check_overrides(const ChannelUse& use, const std::vector<std::string>& overrides) {
  for (const std::string& text : overrides) {
    const std::string_view key = trimmed(text);
    if (!key.starts_with(kChannel) || key.starts_with(kChannel + "change")) continue;
    try {
      use.check(text);
    } catch (const UsageError& error) {
      throw UsageError(std::string("--set ") + error.what());
    }
  }
}

std::string why_not_by_rules(const std::string& name, const LinkConfig& link) {
  if (!kind_of(link).needs_position) return "";
  return fmt::format(
      "link \"{}\" has model = \"{}\", which needs to know where the vehicle is; "
      "rules decode nothing",
      name, link.model);
}

std::string link_key(const std::string& name) {
  const bool of_pair = name == "uplink" || name == "downlink";
  return kChannel + (of_pair ? "" : "links.") + name + ".";
}

const LinkConfig& link_config(const ChannelSettings& channel, const std::string& name) {
  if (name == "uplink") return channel.uplink;
  if (name == "downlink") return channel.downlink;
  return channel.links.at(name);
}

}  // namespace tether
