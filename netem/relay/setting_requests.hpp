#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <tether/channel_setting_result_t.hpp>
#include <tether/channel_setting_t.hpp>
#include <vector>

#include "common/base/counters.hpp"
#include "common/bus/bus.hpp"
#include "common/bus/channel_names.hpp"
#include "common/loop/event_loop.hpp"
#include "netem/channel/change.hpp"

namespace tether {

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

}  // namespace tether
