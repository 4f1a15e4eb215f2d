#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "common/node/event_loop.hpp"
#include "netem/channel/settings.hpp"
#include "netem/fit/link_expectation.hpp"
#include "netem/link/link.hpp"
#include "netem/relay/make_links.hpp"
#include "netem/statistics/channel_check.hpp"

namespace tether {

/// Fates of the first `count` packets of a link, and nothing else: no vehicle, no
/// controller. They are offered from t = 0 on as `traffic` says.
std::vector<PacketFate> sample_fates(Link& link, const LinkTraffic& traffic, std::int64_t count);

/// Watches a link and compares it with what its configuration says. O(1) per packet, bounded
/// memory.
///
/// Not compared, with the reason: what LinkExpectation leaves open; bursts and correlation if
/// packets fell into outages; delays if packets found no room. Packets before t = 0 do not count:
/// states do not move yet.
class LinkMonitor {
 public:
  explicit LinkMonitor(LinkExpectation expected);

  /// Link::Observer.
  void on_packet(const PacketFate& fate);
  /// Models that move in time: the process is in `state` from `now` on. Call at each transition,
  /// and for t = 0.
  void on_state(int state, Instant now);

  /// Whether on_state() is needed.
  bool wants_states() const { return sojourns_.has_value() && expected_.moves_in_time; }
  /// Offered since t = 0.
  std::int64_t packets() const { return packets_; }

  /// The comparison of what happened before `end`.
  std::vector<ChannelCheck> checks(Instant end, const ChannelCheckOptions& options = {}) const;

 private:
  /// The open checks, as measured: with intervals by the packets' own correlation, and no verdict.
  std::vector<ChannelCheck> open_checks(double confidence) const;
  void leave_open(std::vector<ChannelCheck>& checks, double confidence) const;

  LinkExpectation expected_;
  LossRecord loss_;
  DelayStatistics delays_;
  std::optional<SojournStatistics> sojourns_;  // only for channels with two or more states
  std::int64_t packets_ = 0;
  std::int64_t in_outages_ = 0;
  std::int64_t overflowed_ = 0;
};

/// How the two links of a scenario compare with their configuration.
struct ChannelReport {
  struct Direction {
    std::int64_t packets = 0;
    std::vector<ChannelCheck> checks;
  };
  Direction uplink;
  Direction downlink;
};

/// Traffic through the two links.
struct ChannelTraffic {
  LinkTraffic uplink;
  LinkTraffic downlink;
};

/// Watches the links of a run; changes nothing in it. Outlives neither the loop nor the links.
class ChannelWatch {
 public:
  /// Before the first packet. Takes the links' observers.
  ChannelWatch(const ChannelSettings& channel, const ChannelTraffic& traffic, EventLoop& loop,
               Link& uplink, Link& downlink);
  ChannelWatch(const ChannelWatch&) = delete;
  ChannelWatch& operator=(const ChannelWatch&) = delete;

  /// At the run's end.
  ChannelReport report(Instant end) const;

 private:
  void watch_state(Link& link, LinkMonitor& monitor);

  EventLoop& loop_;
  LinkMonitor uplink_;
  LinkMonitor downlink_;
};

/// Traffic that `try_channel` offers, and its progress.
struct ChannelTrial {
  std::int64_t packets = 1'000'000;                       ///< to each link
  std::function<void(std::int64_t offered)> on_progress;  ///< now and then; may be empty
};

/// Offers each link packets at the rate and of the size of its traffic, from t = 0 on, and nothing
/// else: no vehicle, no controller. Models that need the vehicle's position get none.
ChannelReport try_channel(const NetemSettings& settings, const ChannelTraffic& traffic,
                          const ChannelTrial& trial);

}  // namespace tether
