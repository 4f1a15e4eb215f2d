#include "can_bridge/safety/command_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {

bool CommandWatch::offer(Instant now, Instant stamp, std::int64_t seq, const Twist& twist) {
  if (!is_usable(twist)) {
    ++non_finite_;
    return false;
  }
  if (!guard_.accept(now, stamp, seq)) return false;
  as_of_ = std::min(stamp, now);
  actuator_.on_command(now, twist);
  return true;
}

bool CommandWatch::offer(Instant now, PlanSource source, Plan plan) {
  const Instant stamp = plan.stamp;
  if (!actuator_.on_plan(now, source, std::move(plan))) return false;
  plan_as_of_ = std::min(stamp, now);
  return true;
}

void CommandWatch::end_plans(Instant now) { actuator_.end_plans(now); }

std::optional<Duration> CommandWatch::plan_silence(Instant now) const {
  if (!actuator_.plan_age(now)) return std::nullopt;
  return now - plan_as_of_;
}

std::optional<Duration> CommandWatch::age(Instant now) const {
  if (const auto plan_age = actuator_.plan_age(now)) return plan_age;
  if (!as_of_) return std::nullopt;
  return now - *as_of_;
}

std::string CommandWatch::age_text(Instant now, const char* verb) const {
  const double age_ms = std::floor(to_milliseconds(age(now).value_or(Duration{0})));
  return actuator_.plan_age(now)
             ? fmt::format("the horizon of the plan in force {} {:.0f} ms past", verb, age_ms)
             : fmt::format("the newest command {} {:.0f} ms old", verb, age_ms);
}

bool CommandWatch::is_zero(Instant now) const {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  const Twist u = twist(now);
  return age(now) && std::abs(u.v_mps) < kTiny_mps && std::abs(u.omega_radps) < kTiny_radps;
}

void CommandWatch::list(CounterList& out) const {
  guard_.list("command", out);
  out.emplace_back("command.non_finite", non_finite_);
  actuator_.list(out);
}

}  // namespace tether
