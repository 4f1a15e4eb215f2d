#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <vector>

#include "common/base/counters.hpp"
#include "common/node/bus.hpp"
#include "common/node/channel_names.hpp"
#include "common/node/event_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/channel/change.hpp"
#include "netem/channel/models.hpp"
#include "netem/channel/use.hpp"
#include "netem/link/link.hpp"
#include "netem/relay/running_link.hpp"

namespace tether {

/// Changes the settings of links that are in use, all that are asked for or none.
class ChannelControl {
 public:
  /// `models`: the links', which are those of `use`.
  ChannelControl(const NetemSettings& settings, ChannelModels models,
                 ChannelUse use = kVehicleLinks)
      : in_force_(settings), models_(std::move(models)), use_(std::move(use)) {}

  /// With the channel's settings as they are now.
  const NetemSettings& in_force() const { return in_force_; }

  /// Settings of the links in use that differ from the defaults.
  std::vector<ChannelSetting> settings() const;

  /// Gives the links these settings ("downlink.prr=0.45": netem/channel/change.hpp)
  /// from their next packet on; Link::apply() and renew_models() say what stays. `links`: in the
  /// order of the use. Returns what was asked for or became another. Reads files. Throws,
  /// UsageError with the reason for what is not allowed or of no effect on these links, and then
  /// nothing has changed.
  std::vector<ChannelSetting> change(const std::vector<std::string>& settings, Instant now,
                                     const std::vector<Link*>& links);

  /// Slow part of change(), which reads files, as work for a thread of its own: they are
  /// kept then. None if no file is needed, or if change() refuses the settings anyway.
  std::function<void()> reading(const std::vector<std::string>& settings) const;

 private:
  ChannelChange wanted(const std::vector<std::string>& settings) const;

  NetemSettings in_force_;
  ChannelModels models_;
  ChannelUse use_;
};

/// Whether all of channel.change can be done, files and chains included. Throws UsageError.
void try_changes(const NetemSettings& settings, const ChannelUse& use = kVehicleLinks);

/// Takes requests for other settings from NET/SET and answers each on NET/SETTINGS. A request with
/// the utime and seq of one of the last 64 is a repetition: it gets the same answer again. How old
/// a request is does not matter, so that recorded ones can be played to a relay of another run.
/// Requests are carried out one after another; while one is prepared, those behind it wait.
class SettingRequests {
 public:
  /// Puts settings ("KEY=VALUE") in force; none: nothing to do. Returns what is to be answered.
  /// Throws with the reason, having changed nothing, if it refuses.
  using Apply = std::function<std::vector<ChannelSetting>(const std::vector<std::string>&)>;

  /// Slow work in a thread of its own before `Apply`; may be none.
  using Prepare = std::function<std::function<void()>(const std::vector<std::string>&)>;

  /// Listens and answers on all `buses`; one that is named twice in a row counts once.
  SettingRequests(EventLoop& loop, std::vector<Bus*> buses, const ChannelNames& channels,
                  Prepare prepare, Apply apply);
  SettingRequests(const SettingRequests&) = delete;
  SettingRequests& operator=(const SettingRequests&) = delete;

  /// A request that came another way than from the buses.
  void take(const channel_setting_t& request);

  /// "settings.applied" and so on; only those that happened.
  void list_counters(CounterList& out) const;

 private:
  void go_on();
  void carry_out_next();
  const channel_setting_result_t* known(const channel_setting_t& request) const;
  channel_setting_result_t carried_out(const channel_setting_t& request);
  void answer(channel_setting_result_t result);

  EventLoop& loop_;
  std::vector<Bus*> buses_;
  std::string answers_;
  Prepare prepare_;
  Apply apply_;
  std::deque<channel_setting_t> waiting_;          // in order; the first is being prepared
  std::deque<channel_setting_result_t> answered_;  // the oldest first
  std::int64_t seq_ = 0;
  std::int64_t applied_ = 0;
  std::int64_t refused_ = 0;
  std::int64_t repeated_ = 0;
  std::int64_t undecodable_ = 0;
};

/// A request for `settings`, "KEY=VALUE" each; what has no '=' is all key.
channel_setting_t setting_request(std::int64_t utime, std::int64_t seq,
                                  const std::vector<std::string>& settings);

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
