#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "common/loop/event_loop.hpp"
#include "netem/channel/settings.hpp"
#include "netem/check/link_monitor.hpp"
#include "netem/relay/make_links.hpp"

namespace tether {

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
