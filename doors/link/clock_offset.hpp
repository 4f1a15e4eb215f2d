#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "common/base/time.hpp"

namespace tether::link {

/// Nanoseconds from min to max.
struct IntervalNs {
  std::int64_t min_ns = 0;
  std::int64_t max_ns = 0;
};

/// The least of an interval, by its amount: 0 if it may be 0. Seconds.
constexpr double nearest_to_zero_s(const IntervalNs& interval) {
  const std::int64_t ns = interval.min_ns > 0   ? interval.min_ns
                          : interval.max_ns < 0 ? interval.max_ns
                                                : 0;
  return static_cast<double>(ns) * 1e-9;
}

/// By how much a peer's clock is ahead of ours: an interval that holds the truth whatever the
/// delays are, as long as none is negative and the clock rates differ by at most kDrift.
///
/// A datagram sent at T1 and heard at T2 took T2 − T1 − offset ≥ 0, and one back, sent at T3 and
/// heard at T4, T4 − T3 + offset ≥ 0 (RFC 5905 has the four times). So
///
///     T3 − T4 ≤ offset ≤ T2 − T1,
///
/// and of many datagrams the narrowest bounds count, those of the fastest each way: the interval is
/// as wide as the shortest round trip that could have been made of them, and its middle is off by
/// half of that at most. A bound of the past is widened by what clocks may have drifted since.
class ClockOffset {
 public:
  /// Two clocks of ±50 ppm.
  static constexpr double kDrift = 100e-6;
  static constexpr Duration kMemory = std::chrono::seconds{30};

  /// A datagram of the peer's sent at `sent_ns` of its clock, heard at `heard_ns` of ours.
  void on_heard(Instant now, std::int64_t sent_ns, std::int64_t heard_ns);
  /// One of ours sent at `sent_ns` of our clock, at `when`, heard at `heard_ns` of the peer's.
  void on_echo(Instant when, std::int64_t sent_ns, std::int64_t heard_ns);

  /// nullopt before there are datagrams of both directions.
  std::optional<IntervalNs> at(Instant now) const;

  /// How often new bounds contradicted all before: a clock was set. What was before is forgotten
  /// then.
  std::int64_t steps() const { return steps_; }

 private:
  struct Bound {
    Instant when;
    std::int64_t ns = 0;
  };
  /// The best of a while.
  struct Bucket {
    Instant begin;
    std::optional<Bound> lower;
    std::optional<Bound> upper;
  };

  Bucket& bucket(Instant when);
  void check(Instant now, const Bucket& newest);

  std::deque<Bucket> buckets_;
  std::int64_t steps_ = 0;
};

}  // namespace tether::link
