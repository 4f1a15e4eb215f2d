#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "netem/check/link_expectation.hpp"
#include "netem/link/link.hpp"
#include "netem/statistics/channel_check.hpp"

namespace tether {

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

}  // namespace tether
