#pragma once

#include <functional>
#include <string>
#include <vector>

#include "common/base/counters.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/loop/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/relay/channel_control.hpp"
#include "netem/relay/running_link.hpp"
#include "netem/relay/setting_requests.hpp"

namespace tether {

/// The settings of a relay's links while they are in use: takes others from NET/SET, answers on
/// NET/SETTINGS, and publishes those of channel.change on NET/SET itself, at their times. After a
/// change all links report.
class LiveSettings {
 public:
  /// `models`: the links', which are those of `use`, in its order. `buses`: where requests come
  /// from, the first for channel.change. `on_change`: called behind each change. Tries
  /// channel.change; throws UsageError for what cannot be done.
  LiveSettings(
      const NetemSettings& settings, ChannelModels models, const ChannelUse& use,
      std::vector<RunningLink*> links, EventLoop& loop, const std::vector<Bus*>& buses,
      std::function<void()> on_change = [] {});
  LiveSettings(const LiveSettings&) = delete;
  LiveSettings& operator=(const LiveSettings&) = delete;

  /// With the channel's settings as they are now.
  const NetemSettings& in_force() const { return control_.in_force(); }

  /// "settings.applied" and so on; only those that happened.
  void list_counters(CounterList& out) const { requests_.list_counters(out); }

 private:
  void schedule_changes(const NetemSettings& settings, Bus& bus);
  std::vector<ChannelSetting> change(const std::vector<std::string>& settings);

  EventLoop& loop_;
  ChannelNames channels_;
  std::vector<RunningLink*> links_;
  std::function<void()> on_change_;
  ChannelControl control_;
  SettingRequests requests_;
};

}  // namespace tether
