#include "common/node/stream_guard.hpp"

namespace tether {

bool StreamGuard::may_follow(const Place& place, const Place& before) const {
  const std::int64_t sent =
      (place.stamp - before.stamp) / std::chrono::microseconds{1} * kFastest_hz / 1'000'000;
  return !config_.counts_up || place.seq - before.seq <= sent + kAlwaysPossible;
}

/// Sets jump_to_, which stays only for the message that goes on from there.
bool StreamGuard::is_jump(const Place& place) {
  if (may_follow(place, *last_)) {  // every lower number may follow, too
    jump_to_.reset();
    return false;
  }
  const bool goes_on = jump_to_ && place.stamp > jump_to_->stamp && place.seq > jump_to_->seq &&
                       may_follow(place, *jump_to_);
  if (goes_on) return false;
  jump_to_ = place;
  ++counters_.jumped;
  return true;
}

bool StreamGuard::accept(Instant now, Instant stamp, std::int64_t seq) {
  if (seq < 0) {
    ++counters_.invalid_seq;
    return false;
  }
  if (stamp < config_.earliest) {
    ++counters_.before_start;
    return false;
  }
  if (stamp > now + config_.max_ahead) {
    ++counters_.from_future;
    return false;
  }
  const Place place{stamp, seq};
  if (last_) {
    if (seq == last_->seq && stamp == last_->stamp) {
      ++counters_.duplicated;
      return false;
    }
    if (stamp < last_->stamp || (stamp == last_->stamp && seq < last_->seq)) {
      ++(seq > last_->seq ? counters_.time_backwards : counters_.reordered);
      return false;
    }
    if (is_jump(place)) return false;
    if (seq <= last_->seq || jump_to_) {
      ++counters_.restarts;
    } else if (__builtin_add_overflow(counters_.missed, seq - last_->seq - 1, &counters_.missed)) {
      counters_.missed = INT64_MAX;  // where numbers need not count up by 1
    }
  }
  last_ = place;
  jump_to_.reset();
  ++counters_.accepted;
  return true;
}

void StreamGuard::list(const std::string& prefix, CounterList& out) const {
  out.emplace_back(prefix + ".accepted", counters_.accepted);
  out.emplace_back(prefix + ".duplicated", counters_.duplicated);
  out.emplace_back(prefix + ".reordered", counters_.reordered);
  out.emplace_back(prefix + ".time_backwards", counters_.time_backwards);
  out.emplace_back(prefix + ".from_future", counters_.from_future);
  out.emplace_back(prefix + ".invalid_seq", counters_.invalid_seq);
  out.emplace_back(prefix + ".before_start", counters_.before_start);
  if (counters_.jumped > 0) out.emplace_back(prefix + ".jumped", counters_.jumped);
  out.emplace_back(prefix + ".restarts", counters_.restarts);
  out.emplace_back(prefix + ".missed", counters_.missed);
}

}  // namespace tether
