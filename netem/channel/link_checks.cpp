#include "netem/channel/link_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/models/kinds.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

void check_shared_state(const ChannelSettings& channel, const std::string& source) {
  const LinkConfig &uplink = channel.uplink, &downlink = channel.downlink;
  if (!channel.shared_state) return;
  const auto need = [&source](const std::string& what) {
    throw UsageError(fmt::format("{}: channel.shared_state = true needs {}", source, what));
  };
  if (uplink.model != downlink.model) need("the same model for uplink and downlink");
  const ChannelModelKind& kind = kind_of(uplink);
  const std::string missing =
      kind.not_shared != nullptr ? kind.not_shared(uplink, downlink) : std::string();
  if (!missing.empty()) need(missing);
  if (kind.moves(uplink) == ChannelModelKind::Moves::per_packet) {
    need(fmt::format("a model that moves in time: \"{}\" moves with each link's own packets",
                     kind.name));
  }
}

}  // namespace

std::string why_no_effect(const std::string& prefix, const LinkConfig& link,
                          const std::string& part) {
  const ChannelModelKind& kind = kind_of(link);
  std::string model_is = fmt::format("{}model is \"{}\"", prefix, kind.name);
  if (part == "prr" && !kind.uses_prr) return model_is;
  if (part == "delay_ms" && !kind.uses_delay_ms) return model_is;
  for (const ChannelModelKind& other : channel_model_kinds()) {
    if (!part.starts_with(other.name + ".")) continue;
    if (other.name != kind.name) return model_is;
    return kind.why_no_effect != nullptr ? kind.why_no_effect(prefix, link, part) : "";
  }
  return why_no_effect_on_stages(prefix, link, part);
}

void resolve_link(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.resolve != nullptr) kind.resolve(prefix, link, level);
  }
}

std::string why_no_link_name(const std::string& name, const ChannelSettings& channel) {
  if (!is_identifier(name)) return "must be letters, digits, '-' and '_', at most 32";
  const auto upper = [](std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    return text;
  };
  const std::string report = upper(name);
  for (const char* taken : {"UPLINK", "DOWNLINK", "COUNTERS", "SET", "SETTINGS"}) {
    if (report == taken) return fmt::format("channel NET/{} has another meaning", taken);
  }
  for (const auto& [other, unused] : channel.links) {
    if (other == name || upper(other) != report) continue;
    return fmt::format("differs from \"{}\" only in case: both would report on NET/{}", other,
                       report);
  }
  return "";
}

void check_channel(const ChannelSettings& channel, const std::string& source) {
  channel.for_each_link([&source](const std::string& name, const LinkConfig& link) {
    const LoadedLink loaded{link, "channel." + name + ".", source};
    if (kind_of(link).check != nullptr) kind_of(link).check(loaded);
    for (const LinkStageKind& stage : link_stage_kinds()) {
      if (stage.check != nullptr) stage.check(loaded);
    }
  });
  check_shared_state(channel, source);
}

}  // namespace tether
