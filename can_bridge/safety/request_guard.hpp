#pragma once

#include <cstdint>
#include <optional>

#include "common/base/time.hpp"
#include "common/node/stream_guard.hpp"

namespace tether {

/// The requests of drive_request_t, same numbers.
enum class DriveRequest : std::int32_t { arm = 1, disarm, estop, estop_release, reset, alive };

/// Lets an operator's requests through, each once and only while fresh: stamped no more than a
/// second ago and not more than kMaxAhead in the future (so much may the clocks of two well-kept
/// hosts differ), and with a new number, as StreamGuard demands; several programs number them, each
/// in its own way. So an ARM that was recorded, delayed or repeated arms nothing. A bridge that has
/// restarted does not know which numbers are new: what was stamped before its start is refused.
///
/// ESTOP and DISARM are exceptions: they act whatever their stamp and number. A late one still
/// means that an operator wanted the vehicle to stand. ALIVE is a stream of its own, because
/// another program than the one that arms sends it.
class RequestGuard {
 public:
  static constexpr Duration kFresh = std::chrono::seconds{1};
  static constexpr Duration kMaxAhead = std::chrono::milliseconds{50};

  /// Stamps before `earliest` are of another run.
  explicit RequestGuard(Instant earliest)
      : guard_({kMaxAhead, earliest, false}), alive_guard_({kMaxAhead, earliest, false}) {}

  /// The bridge lives from `now` on. Before the first request; later calls do nothing.
  void start(Instant now);

  /// The request to carry out now, if any. `request` is the message's number.
  std::optional<DriveRequest> accept(Instant now, Instant stamp, std::int64_t seq,
                                     std::int32_t request);

  /// Appends "request.accepted", "request.stale", "request.unknown" …
  void list(CounterList& out) const;

 private:
  bool started_ = false;
  StreamGuard guard_;
  StreamGuard alive_guard_;
  std::int64_t stale_ = 0;
  std::int64_t unknown_ = 0;
};

}  // namespace tether
