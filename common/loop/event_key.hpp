#pragma once

#include <compare>
#include <cstdint>

#include "common/base/time.hpp"

namespace tether {

/// Place of an event in a run that several nodes share (docs/reference/time.md). Events happen by
/// time, then by TimerQueue's order; a message that several nodes receive is one event for each, by
/// the nodes' rank. The default is after everything.
struct EventKey {
  Instant when = Instant::max();
  std::uint64_t order = INT64_MAX;
  std::int32_t rank = INT32_MAX;

  // NOLINTNEXTLINE(modernize-use-nullptr): a false alarm
  friend auto operator<=>(const EventKey&, const EventKey&) = default;
};

/// Times as the protocol's messages have them.
inline Instant from_ns(std::int64_t ns) { return Instant{Duration{ns}}; }
inline std::int64_t to_ns(Instant t) { return t.time_since_epoch().count(); }

/// The first number of what is scheduled or published under a grant. Grants follow one another and
/// their numbers grow, so these numbers sort as those of one queue for all nodes would. A grant has
/// room for 2^24 numbers, a run for 2^32 grants.
constexpr std::uint64_t first_insertion(std::int64_t grant) {
  return static_cast<std::uint64_t>(grant) << 24;
}

/// Number of the first grant. What a node schedules before it joins has the node's rank, a smaller
/// number, in place of a grant's.
inline constexpr std::int64_t kFirstGrant = 16;

}  // namespace tether
