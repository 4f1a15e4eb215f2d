#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "common/base/counters.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Lets each message of a stamped, numbered stream through at most once and never backwards.
///
/// A message is rejected, and then refreshes nothing, when it is
/// - `from_future`: stamped more than `max_ahead` after `now` (a wrong clock would otherwise make
///   every later message look old);
/// - `invalid_seq`: numbered below zero;
/// - `before_start`: stamped before `earliest`, so of another run;
/// - `duplicated`: the newest accepted one again;
/// - `reordered`: numbered and stamped no later than the newest accepted one;
/// - `time_backwards`: numbered later but stamped earlier than the newest accepted one;
/// - `jumped`: numbered so much later than the newest accepted one that no loss explains it,
/// because
///   no publisher sends at kFastest_hz. If the next message goes on from there, the publisher has
///   restarted with other numbers (as in RFC 3550, appendix A.1).
/// The same or a lower number with a later stamp is a publisher that restarted: accepted, and
/// counted in `restarts`. `missed` counts the numbers skipped so far (lost or still on the way).
class StreamGuard {
 public:
  /// Ten times the fastest rate that a scenario may ask for.
  static constexpr std::int64_t kFastest_hz = 10'000;
  /// More than messages of one stamp, or of two clocks' difference, are apart.
  static constexpr std::int64_t kAlwaysPossible = 1000;

  struct Config {
    Duration max_ahead = std::chrono::seconds{1};
    Instant earliest = kStart;  ///< the run's start, earlier by its lead time
    bool counts_up = true;      ///< by 1; false: numbers only ascend, and no jump is too large
  };
  struct Counters {
    std::int64_t accepted = 0;
    std::int64_t duplicated = 0;
    std::int64_t reordered = 0;
    std::int64_t time_backwards = 0;
    std::int64_t from_future = 0;
    std::int64_t invalid_seq = 0;
    std::int64_t before_start = 0;
    std::int64_t jumped = 0;
    std::int64_t restarts = 0;
    std::int64_t missed = 0;
  };

  StreamGuard() = default;
  explicit StreamGuard(const Config& config) : config_(config) {}

  /// The receiver has started at `now`: what was stamped before is of another run, too.
  void start(Instant now) { config_.earliest = std::max(config_.earliest, now); }

  /// Whether a message stamped `stamp` and numbered `seq`, arriving at `now`, may be used.
  bool accept(Instant now, Instant stamp, std::int64_t seq);

  const Counters& counters() const { return counters_; }

  /// Appends all counters, named "<prefix>.accepted" and so on; `jumped` only if there was any.
  void list(const std::string& prefix, CounterList& out) const;

 private:
  struct Place {
    Instant stamp;
    std::int64_t seq;
  };
  /// Whether losses alone may lie between two messages, the second with the greater number.
  bool may_follow(const Place& place, const Place& before) const;
  bool is_jump(const Place& place);

  Config config_;
  Counters counters_;
  std::optional<Place> last_;     ///< accepted
  std::optional<Place> jump_to_;  ///< place of the newest message, if it was refused as a jump
};

}  // namespace tether
