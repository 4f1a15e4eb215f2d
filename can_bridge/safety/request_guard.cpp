#include "can_bridge/safety/request_guard.hpp"

#include <utility>

namespace tether {

void RequestGuard::start(Instant now) {
  if (std::exchange(started_, true)) return;
  guard_.start(now);
  alive_guard_.start(now);
}

std::optional<DriveRequest> RequestGuard::accept(Instant now, Instant stamp, std::int64_t seq,
                                                 std::int32_t request) {
  if (request < static_cast<std::int32_t>(DriveRequest::arm) ||
      request > static_cast<std::int32_t>(DriveRequest::alive)) {
    ++unknown_;
    return std::nullopt;
  }
  const auto wanted = static_cast<DriveRequest>(request);
  const bool fresh = now - stamp <= kFresh;
  if (!fresh) ++stale_;
  StreamGuard& guard = wanted == DriveRequest::alive ? alive_guard_ : guard_;
  const bool accepted = fresh && guard.accept(now, stamp, seq);
  const bool is_stop = wanted == DriveRequest::estop || wanted == DriveRequest::disarm;
  if (accepted || is_stop) return wanted;
  return std::nullopt;
}

void RequestGuard::list(CounterList& out) const {
  guard_.list("request", out);
  out.emplace_back("request.stale", stale_);
  out.emplace_back("request.unknown", unknown_);
}

}  // namespace tether
