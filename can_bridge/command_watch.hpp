#pragma once

#include <cstdint>
#include <optional>

#include "common/pose.hpp"
#include "common/stream_guard.hpp"
#include "common/time.hpp"

namespace tether {

/// Decides which twist commands count and how old the newest of them is.
///
/// Rejected, counted and of no effect whatever, above all not on the age: numbers that are not
/// finite or absurd (is_usable), and what StreamGuard rejects (duplicated, late, from the future or
/// of another run).
///
/// Age is now − min(stamp, arrival): time spent in the network counts, for a command that was
/// decided half a second ago says nothing of the present. Stamp and arrival are two hosts' clocks.
/// A sender's clock that is behind by d makes every command look d older: the vehicle stops early
/// or refuses to arm. One that is ahead hides up to d of the network's delay, but never of the time
/// since the arrival; beyond the guard's max_ahead (SafetyCore: 50 ms or less) it is rejected.
class CommandWatch {
 public:
  explicit CommandWatch(const StreamGuard::Config& config) : guard_(config) {}

  /// Whether the command arriving at `now` is accepted.
  bool offer(Instant now, Instant stamp, std::int64_t seq, const Twist& twist);

  /// Of the newest accepted command; none before the first.
  std::optional<Duration> age(Instant now) const;
  /// The newest accepted command; zero before the first.
  const Twist& twist() const { return twist_; }
  /// There is one, and it says (almost) nothing but stand still: below 1 mm/s and 1 mrad/s.
  bool is_zero() const;

  /// Appends "command.accepted", "command.non_finite" …
  void list(CounterList& out) const;

 private:
  StreamGuard guard_;
  std::optional<Instant> as_of_;
  Twist twist_;
  std::int64_t non_finite_ = 0;
};

}  // namespace tether
