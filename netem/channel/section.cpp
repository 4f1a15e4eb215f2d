#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "common/base/errors.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/link_checks.hpp"
#include "netem/channel/link_keys.hpp"
#include "netem/channel/settings.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

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
