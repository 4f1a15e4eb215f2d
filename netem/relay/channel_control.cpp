#include "netem/relay/channel_control.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "common/base/errors.hpp"
#include "netem/relay/make_links.hpp"

namespace tether {
namespace {

/// Requests come from the network: what is not a file, such as a pipe, might block the relay.
void check_files(const LinkConfig& config) {
  for (const std::string& file : {config.jitter.file, config.trace.file, config.map.file}) {
    std::error_code error;
    if (file.empty() || !std::filesystem::exists(file, error)) continue;
    if (std::filesystem::is_regular_file(file, error)) continue;
    throw UsageError(fmt::format("{} is not a regular file", file));
  }
}

Link::Change prepare(const Link& link, const Scenario& before, const Scenario& after,
                     const ChannelModels& models, const std::string& name) {
  const LinkConfig& config = link_config(after, name);
  std::vector<double> table_ms;
  if (config.jitter != link_config(before, name).jitter) table_ms = load_delay_table(after, name);
  return link.prepare(config, models.of(name).process, link_streams(before, name), table_ms);
}

}  // namespace

std::vector<ChannelSetting> ChannelControl::settings() const {
  return use_.select(channel_settings(in_force_));
}

std::vector<ChannelSetting> ChannelControl::change(const std::vector<std::string>& settings,
                                                   Instant now, const std::vector<Link*>& links) {
  for (const std::string& setting : settings) use_.check(setting);
  ChannelChange wanted = change_channel(in_force_, settings);
  use_.check_models(wanted.scenario);
  wanted.scenario.channel.for_each_link(
      [](const std::string&, const LinkConfig& link) { check_files(link); });
  ChannelMoment moment{now, {}};
  for (std::size_t i = 0; i < links.size(); ++i) {
    moment.offered[use_.links[i]] = links[i]->counters().offered;
  }
  ChannelModels models = renew_models(models_, in_force_, wanted.scenario, moment);
  std::vector<Link::Change> changes;
  for (std::size_t i = 0; i < links.size(); ++i) {
    changes.push_back(prepare(*links[i], in_force_, wanted.scenario, models, use_.links[i]));
  }
  // Nothing fails from here on.
  for (std::size_t i = 0; i < links.size(); ++i) links[i]->apply(std::move(changes[i]));
  models_ = std::move(models);
  in_force_ = std::move(wanted.scenario);
  return use_.select(std::move(wanted.settings));
}

void try_changes(const Scenario& scenario, const ChannelUse& use) {
  Scenario in_force = scenario;
  for (const Scenario::Channel::Change& change : scenario.channel.changes) {
    for (const std::string& setting : change.settings) {
      try {
        use.check(setting);
      } catch (const UsageError& error) {
        throw UsageError(fmt::format("channel.change at {} s: {}", change.at_s, error.what()));
      }
    }
    in_force = change_channel(in_force, change.settings).scenario;
    use.check_models(in_force);
    make_links(in_force, make_models(in_force, use.links), use.links);
  }
}

}  // namespace tether
