#include "common/bus/stream_guard.hpp"

namespace tether {

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
  if (any_) {
    if (seq == last_seq_ && stamp == last_stamp_) {
      ++counters_.duplicated;
      return false;
    }
    if (stamp < last_stamp_ || (stamp == last_stamp_ && seq < last_seq_)) {
      ++(seq > last_seq_ ? counters_.time_backwards : counters_.reordered);
      return false;
    }
    if (seq <= last_seq_) {
      ++counters_.restarts;
    } else if (__builtin_add_overflow(counters_.missed, seq - last_seq_ - 1, &counters_.missed)) {
      counters_.missed = INT64_MAX;  // numbers come from the network: any jump is possible
    }
  }
  any_ = true;
  last_stamp_ = stamp;
  last_seq_ = seq;
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
  out.emplace_back(prefix + ".restarts", counters_.restarts);
  out.emplace_back(prefix + ".missed", counters_.missed);
}

}  // namespace tether
