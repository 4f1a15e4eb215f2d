#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/settings.hpp"
#include "netem/link/link_config.hpp"
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

/// Reason why a key of a link has no effect, such as `channel.uplink.model is "fixed"`; empty if
/// the key has an effect. `prefix` is "channel.uplink." and so on, `part` what follows it.
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

/// Turns the pairs that may be given instead of a model's own parameters into these, so that the
/// next level beats them in either form: markov.p_bad and mean_cycle_s, gilbert_elliott.prr and
/// mean_burst. Completes names of files. Throws UsageError for what contradicts itself or cannot
/// be.
void resolve_link(const std::string& prefix, LinkConfig& link, const ScenarioLevel& level) {
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.resolve != nullptr) kind.resolve(prefix, link, level);
  }
}

/// Why a link of [channel.links] cannot have this name; empty if it can. Its reports are on
/// NET/NAME.
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

/// Checks what several keys together must fulfil. Throws UsageError.
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

/// Names of the models that use one of the link's own keys.
std::string names_of_models(bool ChannelModelKind::*uses) {
  std::string names;
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.*uses) names += (names.empty() ? "" : ", ") + kind.name;
  }
  return "model = " + names;
}

/// The keys of one link; they begin with `prefix`.
std::vector<ScenarioKey> link_keys(const std::string& prefix,
                                   const ScenarioField<LinkConfig>& link) {
  KeyTable<LinkConfig> t(prefix, link);
  std::vector<std::string> models;
  for (const ChannelModelKind& kind : channel_model_kinds()) models.push_back(kind.name);
  t.one_of("model", &LinkConfig::model, models, "model that sets loss and delay of the link");
  t.number("prr", TETHER_MEMBER(fixed.prr), kRatio,
           names_of_models(&ChannelModelKind::uses_prr) + ": packet reception ratio");
  t.number("delay_ms", TETHER_MEMBER(fixed.delay_ms), kDelayRange_ms,
           names_of_models(&ChannelModelKind::uses_delay_ms) + ": delay");
  for (const ChannelModelKind& kind : channel_model_kinds()) {
    if (kind.keys != nullptr) t.append(kind.keys({prefix, link}));
  }
  for (const LinkStageKind& stage : link_stage_kinds()) {
    if (stage.keys != nullptr) t.append(stage.keys({prefix, link}));
  }
  // Keys of the link itself come before those of its parts: that is the order of TOML's sections.
  std::vector<ScenarioKey> keys = t.take();
  std::stable_partition(keys.begin(), keys.end(), [&prefix](const ScenarioKey& key) {
    return key.name.find('.', prefix.size()) == std::string::npos;
  });
  return keys;
}

using Channel = ChannelSettings;

constexpr const char* kPrefix = "channel.";
constexpr const char* kLinks = "channel.links.";
constexpr const char* kChanges = "channel.change";
constexpr double kLatestChange_s = 1e6;

ScenarioField<LinkConfig> in_channel(LinkConfig Channel::*link) {
  return {[link](const Scenario& s) -> const LinkConfig& { return s.get<Channel>().*link; },
          [link](Scenario& s) -> LinkConfig& { return s.get<Channel>().*link; }};
}

/// Field of [channel.links]. A link that the scenario does not have is a default one.
ScenarioField<LinkConfig> by_name(const std::string& name) {
  return {[name](const Scenario& s) -> const LinkConfig& {
            static const LinkConfig kDefault;
            const auto& links = s.get<Channel>().links;
            const auto found = links.find(name);
            return found == links.end() ? kDefault : found->second;
          },
          [name](Scenario& s) -> LinkConfig& { return s.get<Channel>().links[name]; }};
}

NamedTables named_links() {
  NamedTables tables;
  tables.prefix = kLinks;
  tables.names = [](const Scenario& scenario) {
    std::vector<std::string> names;
    for (const auto& [name, link] : scenario.get<Channel>().links) names.push_back(name);
    return names;
  };
  tables.keys = [](const std::string& name) {
    return link_keys(kLinks + name + ".", by_name(name));
  };
  tables.make = [](Scenario& scenario, const std::string& name, const std::string& place) {
    auto& channel = scenario.get<Channel>();
    const std::string why = why_no_link_name(name, channel);
    if (!why.empty()) {
      throw UsageError(fmt::format("{}: link name \"{}\" is not allowed: {}", place, name, why));
    }
    channel.links.try_emplace(name);
  };
  return tables;
}

/// nullopt if anything in it is not as it must be.
std::optional<Channel::Change> to_change(const TableList::Table& table) {
  const auto at = table.find("at_s"), set = table.find("set");
  if (table.size() != 2 || at == table.end() || set == table.end()) return std::nullopt;
  const auto* settings = std::get_if<TextList>(&set->second);
  const auto* real = std::get_if<double>(&at->second);
  const auto* whole = std::get_if<std::int64_t>(&at->second);
  if (settings == nullptr || (real == nullptr && whole == nullptr)) return std::nullopt;
  const double at_s = real != nullptr ? *real : static_cast<double>(*whole);
  if (!(std::abs(at_s) <= kLatestChange_s)) return std::nullopt;
  return Channel::Change{at_s, *settings};
}

bool read_changes(Scenario& scenario, const std::vector<TableList::Table>& tables,
                  const std::string& /*place*/) {
  std::vector<Channel::Change> changes;
  for (const TableList::Table& table : tables) {
    const auto change = to_change(table);
    if (!change) return false;
    changes.push_back(*change);
  }
  scenario.get<Channel>().changes = std::move(changes);
  return true;
}

std::string changes_to_toml(const Scenario& scenario) {
  std::string text;
  for (const Channel::Change& change : scenario.get<Channel>().changes) {
    text +=
        fmt::format("\n[[{}]]\nat_s = {}\nset = {}\n", kChanges,
                    to_toml(ScenarioValue(change.at_s)), to_toml(ScenarioValue(change.settings)));
  }
  return text;
}

TableList changes() {
  return {.key = kChanges,
          .allowed = fmt::format(
              "each [[{0}]] must have at_s, a number in [-{1}, {1}], and set, a list of one "
              "\"KEY=VALUE\" or more, and nothing else",
              kChanges, kLatestChange_s),
          .read = read_changes,
          .to_toml = changes_to_toml};
}

/// The link that a key is of, and the key's part behind the link's prefix.
template <class Function>
void with_link_of(const Scenario& scenario, const std::string& key, Function f) {
  if (!key.starts_with(kPrefix)) return;
  scenario.get<Channel>().for_each_link([&](const std::string& name, const LinkConfig& link) {
    const std::string prefix = kPrefix + name + ".";
    if (key.starts_with(prefix)) f(prefix, link, key.substr(prefix.size()));
  });
}

std::string why_useless(const Scenario& scenario, const std::string& key) {
  std::string why;
  with_link_of(scenario, key, [&](const auto& prefix, const LinkConfig& link, const auto& part) {
    why = why_no_effect(prefix, link, part);
  });
  return why;
}

/// Switches of stages that are off go without saying.
bool left_out(const Scenario& scenario, const ScenarioKey& key) {
  bool left_out = false;
  with_link_of(scenario, key.name, [&](const auto&, const LinkConfig&, const auto& part) {
    static const Scenario kDefaults;
    const auto& stages = link_stage_kinds();
    const bool is_switch = std::any_of(stages.begin(), stages.end(), [&part](const auto& stage) {
      return stage.switch_key == part;
    });
    left_out = is_switch && key.get(scenario) == key.get(kDefaults);
  });
  return left_out;
}

/// channel.prr is channel.uplink.prr and channel.downlink.prr.
std::vector<std::string> stands_for(const std::string& key) {
  const std::string prefix = kPrefix;
  const std::string rest = key.starts_with(prefix) ? key.substr(prefix.size()) : "";
  if (rest.empty() || rest == "shared_state" || rest.starts_with("uplink.") ||
      rest.starts_with("downlink.") || rest.starts_with("links.")) {
    return {};
  }
  return {prefix + "uplink." + rest, prefix + "downlink." + rest};
}

std::string short_form(const std::string& key) {
  const std::string uplink = "channel.uplink.";
  return key.starts_with(uplink) ? kPrefix + key.substr(uplink.size()) : "";
}

void end_level(Scenario& scenario, const ScenarioLevel& level) {
  auto& channel = scenario.get<Channel>();
  channel.for_each_link([&](const std::string& name, LinkConfig& link) {
    resolve_link(kPrefix + name + ".", link, level);
  });
  if (!level.has(kChanges)) return;
  for (Channel::Change& change : channel.changes) {
    for (std::string& setting : change.settings) setting = setting_in_folder(setting, level.folder);
  }
}

}  // namespace

ScenarioSection channel_section() {
  KeyTable<Channel> t(kPrefix);
  t.boolean("shared_state", &Channel::shared_state,
            "both directions follow the uplink's state process");
  t.append(link_keys("channel.uplink.", in_channel(&Channel::uplink)));
  t.append(link_keys("channel.downlink.", in_channel(&Channel::downlink)));
  ScenarioSection section{.defaults = Channel{}, .keys = t.take()};
  section.named = named_links();
  section.list = changes();
  section.help =
      "channel.links.NAME.*\n    link of that name, for rules of tether-netem; same keys as "
      "channel.uplink\n"
      "[[channel.change]] at_s = SECONDS, set = [\"KEY=VALUE\", ...]\n"
      "    other settings of the channel from at_s on, all at once; KEY without \"channel.\"; "
      "times ascend\n";
  section.why_no_effect = why_useless;
  section.left_out = left_out;
  section.stands_for = stands_for;
  section.short_form = short_form;
  section.end_level = end_level;
  section.check = [](const Scenario& scenario, const std::string& file) {
    check_channel(scenario.get<Channel>(), file);
    check_changes(scenario.get<Channel>(), file);
  };
  return section;
}

}  // namespace tether
