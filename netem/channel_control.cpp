#include "netem/channel_control.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "common/errors.hpp"
#include "netem/make_links.hpp"

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

Link::Change prepare(const Link& link, const LinkConfig& before, const LinkConfig& after,
                     const LinkModel& model, const LinkStreams& streams) {
  std::vector<double> table_ms;
  if (after.jitter != before.jitter) table_ms = load_delay_table(after.jitter);
  return link.prepare(after, model.process, streams, table_ms);
}

}  // namespace

std::vector<ChannelSetting> ChannelControl::change(const std::vector<std::string>& settings,
                                                   Instant now, Link& uplink, Link& downlink) {
  ChannelChange wanted = change_channel(in_force_, settings);
  const Scenario::Channel &before = in_force_.channel, &after = wanted.scenario.channel;
  check_files(after.uplink);
  check_files(after.downlink);
  ChannelModels models =
      renew_models(models_, in_force_, wanted.scenario,
                   {now, uplink.counters().offered, downlink.counters().offered});
  Link::Change up = prepare(uplink, before.uplink, after.uplink, models.uplink,
                            link_streams(in_force_, "uplink"));
  Link::Change down = prepare(downlink, before.downlink, after.downlink, models.downlink,
                              link_streams(in_force_, "downlink"));
  // Nothing fails from here on.
  uplink.apply(std::move(up));
  downlink.apply(std::move(down));
  models_ = std::move(models);
  in_force_ = std::move(wanted.scenario);
  return std::move(wanted.settings);
}

void try_changes(const Scenario& scenario) {
  Scenario in_force = scenario;
  for (const Scenario::Channel::Change& change : scenario.channel.changes) {
    in_force = change_channel(in_force, change.settings).scenario;
    make_links(in_force);
  }
}

}  // namespace tether
