#include "can_bridge/command_watch.hpp"

#include <algorithm>
#include <cmath>

namespace tether {

bool CommandWatch::offer(Instant now, Instant stamp, std::int64_t seq, const Twist& twist) {
  if (!is_usable(twist)) {
    ++non_finite_;
    return false;
  }
  if (!guard_.accept(now, stamp, seq)) return false;
  as_of_ = std::min(stamp, now);
  twist_ = twist;
  return true;
}

std::optional<Duration> CommandWatch::age(Instant now) const {
  if (!as_of_) return std::nullopt;
  return now - *as_of_;
}

bool CommandWatch::is_zero() const {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  return as_of_ && std::abs(twist_.v_mps) < kTiny_mps && std::abs(twist_.omega_radps) < kTiny_radps;
}

void CommandWatch::list(CounterList& out) const {
  guard_.list("command", out);
  out.emplace_back("command.non_finite", non_finite_);
}

}  // namespace tether
