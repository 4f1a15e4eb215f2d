#include "netem/relay/live_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <utility>

#include "common/base/errors.hpp"
#include "common/node/message_io.hpp"
#include "common/vehicle/vehicle_settings.hpp"
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

namespace {

constexpr std::size_t kRemembered = 64;
constexpr std::size_t kMostWaiting = 100;
constexpr std::size_t kLongestValue = 1000;  // a message's decoder takes 64 KiB at most

std::string cut(std::string text) {
  if (text.size() <= kLongestValue) return text;
  text.resize(kLongestValue);
  return text + "...";
}

std::vector<std::string> settings_of(const channel_setting_t& request) {
  std::vector<std::string> settings;
  for (std::size_t i = 0; i < request.key.size(); ++i) {
    settings.push_back(request.key[i] + "=" + request.value[i]);
  }
  return settings;
}

channel_setting_result_t result_of(const channel_setting_t& request, const std::string& reason) {
  channel_setting_result_t result{};
  result.request_utime = request.utime;
  result.request_seq = request.seq;
  result.reason = reason;
  return result;
}

}  // namespace

SettingRequests::SettingRequests(EventLoop& loop, std::vector<Bus*> buses,
                                 const ChannelNames& channels, Prepare prepare, Apply apply)
    : loop_(loop),
      buses_(std::move(buses)),
      answers_(channels.net_settings),
      prepare_(std::move(prepare)),
      apply_(std::move(apply)) {
  buses_.erase(std::unique(buses_.begin(), buses_.end()), buses_.end());
  for (Bus* bus : buses_) {
    subscribe<channel_setting_t>(*bus, channels.net_set, kDeepQueue, undecodable_,
                                 [this](const channel_setting_t& m) { take(m); });
  }
}

void SettingRequests::take(const channel_setting_t& request) {
  if (waiting_.size() == kMostWaiting) {
    ++refused_;
    return answer(result_of(request, "too many requests wait already"));
  }
  waiting_.push_back(request);
  if (waiting_.size() == 1) go_on();
}

void SettingRequests::go_on() {
  while (!waiting_.empty()) {
    std::function<void()> work;
    if (known(waiting_.front()) == nullptr) work = prepare_(settings_of(waiting_.front()));
    if (work) {
      return loop_.aside(std::move(work), [this](Instant) {
        carry_out_next();
        go_on();
      });
    }
    carry_out_next();
  }
}

void SettingRequests::carry_out_next() {
  const channel_setting_t request = waiting_.front();
  if (const channel_setting_result_t* result = known(request)) {
    ++repeated_;
    answer(*result);
  } else {
    answer(carried_out(request));
  }
  waiting_.pop_front();
}

const channel_setting_result_t* SettingRequests::known(const channel_setting_t& request) const {
  const auto found = std::find_if(answered_.begin(), answered_.end(), [&](const auto& result) {
    return result.request_utime == request.utime && result.request_seq == request.seq;
  });
  return found == answered_.end() ? nullptr : &*found;
}

channel_setting_result_t SettingRequests::carried_out(const channel_setting_t& request) {
  channel_setting_result_t result = result_of(request, "");
  const std::vector<std::string> settings = settings_of(request);
  try {
    for (const ChannelSetting& setting : apply_(settings)) {
      result.key.push_back(setting.key);
      result.value.push_back(cut(setting.value));
    }
    result.applied = 1;
  } catch (const std::exception& error) {  // a relay does not end because of what it is asked
    result.reason = cut(error.what());
  }
  result.count = static_cast<std::int32_t>(result.key.size());
  if (!settings.empty()) {
    ++(result.applied != 0 ? applied_ : refused_);
    answered_.push_back(result);
    if (answered_.size() > kRemembered) answered_.pop_front();
  }
  return result;
}

void SettingRequests::answer(channel_setting_result_t result) {
  result.utime = to_utime(loop_.now());
  result.seq = seq_++;
  for (Bus* bus : buses_) publish(*bus, answers_, result);
}

void SettingRequests::list_counters(CounterList& out) const {
  const std::pair<const char*, std::int64_t> counters[] = {{"settings.applied", applied_},
                                                           {"settings.refused", refused_},
                                                           {"settings.repeated", repeated_},
                                                           {"settings.undecodable", undecodable_}};
  for (const auto& [name, value] : counters) {
    if (value > 0) out.emplace_back(name, value);
  }
}

channel_setting_t setting_request(std::int64_t utime, std::int64_t seq,
                                  const std::vector<std::string>& settings) {
  channel_setting_t request{};
  request.utime = utime;
  request.seq = seq;
  for (const std::string& text : settings) {
    const auto equals = text.find('=');
    request.key.push_back(text.substr(0, equals));
    request.value.push_back(equals == std::string::npos ? "" : text.substr(equals + 1));
  }
  request.count = static_cast<std::int32_t>(request.key.size());
  return request;
}

LiveSettings::LiveSettings(const NetemSettings& settings, ChannelModels models,
                           const ChannelUse& use, std::vector<RunningLink*> links, EventLoop& loop,
                           const std::vector<Bus*>& buses, std::function<void()> on_change)
    : loop_(loop),
      channels_(settings.get<VehicleSettings>().name),
      links_(std::move(links)),
      on_change_(std::move(on_change)),
      control_(settings, std::move(models), use),
      requests_(
          loop, buses, channels_,
          [this](const std::vector<std::string>& settings) { return control_.reading(settings); },
          [this](const std::vector<std::string>& settings) { return change(settings); }) {
  try_changes(settings, use);
  schedule_changes(settings, *buses.front());
}

void LiveSettings::schedule_changes(const NetemSettings& settings, Bus& bus) {
  std::int64_t seq = 0;
  for (const ChannelSettings::Change& change : settings.get<ChannelSettings>().changes) {
    // Before anything else that is sent at this instant.
    loop_.at(kStart + from_seconds(change.at_s), Priority::physics,
             [this, &bus, request = setting_request(0, seq++, change.settings)](Instant) mutable {
               request.utime = to_utime(loop_.now());
               publish(bus, channels_.net_set, request);
               if (!bus.hears_itself()) requests_.take(request);
             });
  }
}

std::vector<ChannelSetting> LiveSettings::change(const std::vector<std::string>& settings) {
  if (settings.empty()) return control_.settings();
  std::vector<Link*> links;
  for (RunningLink* running : links_) links.push_back(&running->link());
  auto changed = control_.change(settings, loop_.now(), links);
  on_change_();
  for (RunningLink* running : links_) running->changed();
  return changed;
}

}  // namespace tether
