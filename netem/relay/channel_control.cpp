#include "netem/relay/channel_control.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "common/base/errors.hpp"
#include "netem/channel/settings.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/stages/kinds.hpp"

namespace tether {
namespace {

/// Requests come from the network: what is not a file, such as a pipe, might block the relay.
void check_files(const ChannelSettings& channel) {
  for (const std::string& file : channel_files(channel)) {
    std::error_code error;
    if (!std::filesystem::exists(file, error)) continue;
    if (std::filesystem::is_regular_file(file, error)) continue;
    throw UsageError(fmt::format("{} is not a regular file", file));
  }
}

LinkStages renewed(const Link& link, const NetemSettings& before, const NetemSettings& after,
                   const std::string& name) {
  return renewed_stages(link, link_config(before.get<ChannelSettings>(), name),
                        link_config(after.get<ChannelSettings>(), name), link_key(name),
                        link_streams(before, name));
}

}  // namespace

std::vector<ChannelSetting> ChannelControl::settings() const {
  return use_.select(channel_settings(in_force_.get<ChannelSettings>()));
}

ChannelChange ChannelControl::wanted(const std::vector<std::string>& settings) const {
  for (const std::string& setting : settings) use_.check(setting);
  ChannelChange change = change_channel(in_force_.get<ChannelSettings>(), settings);
  use_.check_models(change.channel);
  check_files(change.channel);
  return change;
}

std::function<void()> ChannelControl::reading(const std::vector<std::string>& settings) const {
  NetemSettings after = in_force_;
  try {
    after.get<ChannelSettings>() = wanted(settings).channel;
  } catch (const UsageError&) {
    return {};
  }
  if (channel_files(after.get<ChannelSettings>()).empty()) return {};
  return [after = std::move(after), links = use_.links] {
    try {
      make_links(after, make_models(after, links), links);
    } catch (const std::exception&) {  // change() will say so
    }
  };
}

std::vector<ChannelSetting> ChannelControl::change(const std::vector<std::string>& settings,
                                                   Instant now, const std::vector<Link*>& links) {
  ChannelChange change = wanted(settings);
  NetemSettings after = in_force_;
  after.get<ChannelSettings>() = std::move(change.channel);
  ChannelMoment moment{now, {}};
  for (std::size_t i = 0; i < links.size(); ++i) {
    moment.offered[use_.links[i]] = links[i]->counters().offered;
  }
  ChannelModels models = renew_models(models_, in_force_, after, moment);
  std::vector<LinkStages> stages;
  for (std::size_t i = 0; i < links.size(); ++i) {
    stages.push_back(renewed(*links[i], in_force_, after, use_.links[i]));
  }
  // Nothing fails from here on.
  for (std::size_t i = 0; i < links.size(); ++i) {
    links[i]->apply(std::move(stages[i]), models.of(use_.links[i]));
  }
  models_ = std::move(models);
  in_force_ = std::move(after);
  return use_.select(std::move(change.settings));
}

void try_changes(const NetemSettings& settings, const ChannelUse& use) {
  NetemSettings in_force = settings;
  for (const ChannelSettings::Change& change : settings.get<ChannelSettings>().changes) {
    for (const std::string& setting : change.settings) {
      try {
        use.check(setting);
      } catch (const UsageError& error) {
        throw UsageError(fmt::format("channel.change at {} s: {}", change.at_s, error.what()));
      }
    }
    auto& channel = in_force.get<ChannelSettings>();
    channel = change_channel(channel, change.settings).channel;
    use.check_models(channel);
    make_links(in_force, make_models(in_force, use.links), use.links);
  }
}

}  // namespace tether
