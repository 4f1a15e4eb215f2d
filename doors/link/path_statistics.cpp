#include "doors/link/path_statistics.hpp"

#include <algorithm>

namespace tether::link {

void PathStatistics::on_received(Instant now, std::int64_t transit_ns, bool first) {
  ++received_;
  if (first) ++first_;
  if (newest_) longest_gap_ = std::max(longest_gap_, now - *newest_);
  newest_ = now;
  transit_min_ns_ = std::min(transit_min_ns_.value_or(transit_ns), transit_ns);
  transit_max_ns_ = std::max(transit_max_ns_.value_or(transit_ns), transit_ns);
  transit_sum_ns_ += static_cast<double>(transit_ns);
  ++transits_;
}

void PathStatistics::on_told(Instant now, std::int64_t sent, std::int64_t received) {
  lost_ += sent - received;
  recent_.push_back({now, sent, received});
  while (now - recent_.front().when > kRecent) recent_.pop_front();
}

void PathStatistics::on_round_trip(std::int64_t ns) {
  if (ns >= 0) round_trip_min_ns_ = std::min(round_trip_min_ns_.value_or(ns), ns);
}

PathReport PathStatistics::report(Instant now) {
  PathReport r;
  r.alive = alive(now);
  r.sent = sent_;
  r.received = received_;
  r.first = first_;
  r.lost = std::max<std::int64_t>(lost_, 0);
  std::int64_t sent = 0, received = 0;
  for (const Told& told : recent_) {
    sent += told.sent;
    received += told.received;
  }
  if (sent > 0) {
    const double kept = static_cast<double>(received) / static_cast<double>(sent);
    r.recent_loss = std::clamp(1.0 - kept, 0.0, 1.0);
  }
  if (newest_) {
    r.age_s = to_seconds(now - *newest_);
    longest_gap_ = std::max(longest_gap_, now - *newest_);
  }
  r.longest_gap_s = to_seconds(longest_gap_);
  r.transit_min_ns = transit_min_ns_;
  r.transit_max_ns = transit_max_ns_;
  if (transits_ > 0) r.transit_mean_ns = transit_sum_ns_ / static_cast<double>(transits_);
  r.round_trip_min_ns = round_trip_min_ns_;
  longest_gap_ = Duration{0};
  transit_min_ns_ = transit_max_ns_ = round_trip_min_ns_ = std::nullopt;
  transit_sum_ns_ = 0.0;
  transits_ = 0;
  return r;
}

}  // namespace tether::link
