#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "common/base/time.hpp"
#include "doors/link/clock_offset.hpp"

namespace tether::link {

/// Measured quality of the direction from a peer by one path.
struct PathReport {
  bool alive = false;
  std::int64_t sent = 0;       ///< datagrams of ours, since the start
  std::int64_t received = 0;   ///< authentic ones of the peer's, each once
  std::int64_t first = 0;      ///< received datagrams that no other path had brought before
  std::int64_t lost = 0;       ///< lost datagrams of the peer, by its own count of sent ones
  double recent_loss = -1.0;   ///< share, over PathStatistics::kRecent; −1: nothing is known
  double age_s = -1.0;         ///< since the newest; −1 before the first
  double longest_gap_s = 0.0;  ///< between two, since the last report
  /// Arrival by our clock minus sending by the peer's: delay − offset. Since the last report; empty
  /// if none came.
  std::optional<std::int64_t> transit_min_ns, transit_max_ns;
  double transit_mean_ns = 0.0;
  /// Shortest time there and back, without the peer's own, since the last report.
  std::optional<std::int64_t> round_trip_min_ns;
};

/// Counts one path to a peer.
class PathStatistics {
 public:
  static constexpr Duration kRecent = std::chrono::seconds{5};
  /// A path without an authentic datagram for this long counts as down: four probes in a row.
  static constexpr Duration kDead = std::chrono::seconds{1};
  static constexpr int kShortInARow = 40;

  void on_sent() { ++sent_; }
  void on_received(Instant now, std::int64_t transit_ns, bool first);
  /// Between the last two PROBES the peer sent `sent`, of which, and of stragglers, `received`
  /// came.
  void on_told(Instant now, std::int64_t sent, std::int64_t received);
  void on_round_trip(std::int64_t ns);
  void on_probe(bool is_long) { short_probes_ = is_long ? 0 : short_probes_ + 1; }

  /// A PROBE of another path came by this one: not in one order on both hosts.
  void on_crossed(Instant now) { crossed_ = now; }
  bool is_crossed(Instant now) const { return crossed_ && now - *crossed_ <= kDead; }
  bool alive(Instant now) const { return newest_ && now - *newest_ <= kDead; }
  /// False: so many short probes came, and no long one, that losses do not explain it. Of p lost,
  /// all of 40 / 3 (1 − p) long ones must have been, for every fourth is long: below 2·10⁻⁶.
  bool carries_long() const { return short_probes_ < kShortInARow; }
  /// Begins a new period.
  PathReport report(Instant now);

 private:
  struct Told {
    Instant when;
    std::int64_t sent;
    std::int64_t received;
  };

  std::int64_t sent_ = 0;
  std::int64_t received_ = 0;
  std::int64_t first_ = 0;
  std::int64_t lost_ = 0;
  std::optional<Instant> newest_;
  Duration longest_gap_{0};
  std::optional<std::int64_t> transit_min_ns_, transit_max_ns_, round_trip_min_ns_;
  double transit_sum_ns_ = 0.0;
  std::int64_t transits_ = 0;
  int short_probes_ = 0;
  std::optional<Instant> crossed_;
  std::deque<Told> recent_;
};

}  // namespace tether::link
