#include "doors/link/clock_offset.hpp"

#include <algorithm>
#include <cmath>

#include "doors/link/wire.hpp"

namespace tether::link {
namespace {

constexpr Duration kBucket = std::chrono::seconds{2};

std::int64_t drift_ns(Duration age) {
  return std::llround(ClockOffset::kDrift * static_cast<double>(std::abs(age.count())));
}

}  // namespace

ClockOffset::Bucket& ClockOffset::bucket(Instant when) {
  while (!buckets_.empty() && when - buckets_.front().begin > kMemory) buckets_.pop_front();
  if (buckets_.empty() || when - buckets_.back().begin >= kBucket)
    buckets_.push_back({when, {}, {}});
  return buckets_.back();
}

void ClockOffset::on_heard(Instant now, std::int64_t sent_ns, std::int64_t heard_ns) {
  if (!is_time(sent_ns) || !is_time(heard_ns)) return;
  const Bound bound{now, sent_ns - heard_ns};
  std::optional<Bound>& best = bucket(now).lower;
  if (best && best->ns - drift_ns(now - best->when) >= bound.ns) return;
  best = bound;
  check(now, {now, bound, std::nullopt});
}

void ClockOffset::on_echo(Instant when, std::int64_t sent_ns, std::int64_t heard_ns) {
  if (!is_time(sent_ns) || !is_time(heard_ns)) return;
  const Bound bound{when, heard_ns - sent_ns};
  std::optional<Bound>& best = bucket(when).upper;
  if (best && best->ns + drift_ns(when - best->when) <= bound.ns) return;
  best = bound;
  check(when, {when, std::nullopt, bound});
}

void ClockOffset::check(Instant now, const Bucket& newest) {
  const std::optional<IntervalNs> interval = at(now);
  if (!interval || interval->min_ns <= interval->max_ns) return;
  ++steps_;
  buckets_.assign(1, newest);
}

std::optional<IntervalNs> ClockOffset::at(Instant now) const {
  IntervalNs all{INT64_MIN, INT64_MAX};
  bool has_lower = false, has_upper = false;
  for (const Bucket& b : buckets_) {
    if (b.lower) {
      all.min_ns = std::max(all.min_ns, b.lower->ns - drift_ns(now - b.lower->when));
      has_lower = true;
    }
    if (b.upper) {
      all.max_ns = std::min(all.max_ns, b.upper->ns + drift_ns(now - b.upper->when));
      has_upper = true;
    }
  }
  if (!has_lower || !has_upper) return std::nullopt;
  return all;
}

}  // namespace tether::link
