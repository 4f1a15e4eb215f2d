#pragma once

#include <algorithm>
#include <cassert>
#include <chrono>
#include <cmath>
#include <cstdint>

namespace tether {

/// The clock of a run: zero is the instant at which the vehicle's reference path starts.
///
/// It has no `now()` on purpose: only event loops own a clock (see event_loop.hpp), everything
/// else is handed the time. In simulated runs it is simulated time; in live runs it is a steady
/// clock anchored at the run's common start, so that it is negative while nodes wait to begin.
struct RunClock {
  using duration = std::chrono::nanoseconds;
  using rep = duration::rep;
  using period = duration::period;
  using time_point = std::chrono::time_point<RunClock>;
  static constexpr bool is_steady = true;
};

using Duration = RunClock::duration;
using Instant = RunClock::time_point;

/// The run's start, t = 0.
inline constexpr Instant kStart{};

/// Nearest nanosecond to `seconds`; |seconds| <= 4e9 (127 years), which callers ensure.
inline Duration from_seconds(double seconds) {
  assert(std::abs(seconds) <= 4e9);
  return Duration{std::llround(seconds * 1e9)};
}

constexpr double to_seconds(Duration d) { return static_cast<double>(d.count()) / 1e9; }
constexpr double to_seconds(Instant t) { return to_seconds(t.time_since_epoch()); }
constexpr double to_milliseconds(Duration d) { return static_cast<double>(d.count()) / 1e6; }

/// First tick of `period` within a lead of `lead` before t = 0: t = 0 itself is on the same grid.
constexpr Instant first_tick(Duration lead, Duration period) {
  return kStart - (lead / period) * period;
}

/// LCM's time stamp: microseconds of run time, rounded down.
constexpr std::int64_t to_utime(Instant t) {
  return std::chrono::floor<std::chrono::microseconds>(t.time_since_epoch()).count();
}

/// Inverse of to_utime. Values beyond ±146 years saturate there: they come from the network, and
/// the difference to any real time must not overflow.
constexpr Instant from_utime(std::int64_t utime_us) {
  constexpr std::int64_t kLimit_us = INT64_MAX / 2000;
  return Instant{std::chrono::microseconds{std::clamp(utime_us, -kLimit_us, kLimit_us)}};
}

}  // namespace tether
