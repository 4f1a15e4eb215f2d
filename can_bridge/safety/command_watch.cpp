#include "can_bridge/safety/command_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {

CommandWatch::CommandWatch(const StreamGuard::Config& config, const ActuatorSettings& actuator,
                           const VehicleConfig& vehicle, Duration max_blind)
    : guard_(config), actuator_(actuator, vehicle, config), max_blind_(max_blind) {
  actuator_.need_poses(max_blind);
}

bool CommandWatch::offer(Instant now, Instant stamp, std::int64_t seq, const Twist& twist,
                         std::optional<Instant> pose) {
  if (!is_usable(twist)) {
    ++non_finite_;
    return false;
  }
  if (pose && *pose + max_blind_ <= now) {
    ++blind_;
    return false;
  }
  const std::int64_t restarts = guard_.counters().restarts;
  if (!guard_.accept(now, stamp, seq)) return false;
  if (guard_.counters().restarts > restarts) note_restart(now);
  as_of_ = std::min(stamp, now);
  actuator_.on_command(now, twist);
  return true;
}

bool CommandWatch::offer(Instant now, PlanSource source, Plan plan) {
  const Instant stamp = plan.stamp;
  if (!actuator_.on_plan(now, source, std::move(plan))) return false;
  if (source == PlanSource::network) plan_as_of_ = std::min(stamp, now);
  return true;
}

void CommandWatch::note_restart(Instant now) {
  constexpr std::size_t kTurns = 5;
  restarts_.push_back(now);
  while (now - restarts_.front() > kSendersWindow) restarts_.pop_front();
  if (restarts_.size() >= kTurns) two_senders_ = true;
}

void CommandWatch::forget_senders() {
  restarts_.clear();
  two_senders_ = false;
}

void CommandWatch::end_plans(Instant now) { actuator_.end_plans(now); }

std::optional<Duration> CommandWatch::plan_silence(Instant now) const {
  if (!actuator_.plan_age(now)) return std::nullopt;
  return plan_as_of_ ? now - *plan_as_of_ : Duration::max();
}

Duration CommandWatch::overdue(Instant now) const {
  const auto since = actuator_.seen();
  return since ? std::max(Duration{0}, now - *since - max_blind_) : Duration{0};
}

std::optional<Duration> CommandWatch::age(Instant now) const {
  if (const auto plan_age = actuator_.plan_age(now)) return std::max(*plan_age, overdue(now));
  if (!as_of_) return std::nullopt;
  return now - *as_of_;
}

std::string CommandWatch::age_text(Instant now, const char* verb) const {
  const Duration age = this->age(now).value_or(Duration{0});
  const double age_ms = std::floor(to_milliseconds(age));
  if (!actuator_.plan_age(now)) {
    return fmt::format("the newest command {} {:.0f} ms old", verb, age_ms);
  }
  if (overdue(now) < age || age == Duration{0}) {
    return fmt::format("the horizon of the plan in force {} {:.0f} ms past", verb, age_ms);
  }
  return fmt::format("the vehicle {} unseen for {:.0f} ms (can.max_blind_s = {})", verb,
                     std::floor(to_milliseconds(age + max_blind_)), to_seconds(max_blind_));
}

bool CommandWatch::is_zero(Instant now) const {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  const Twist u = twist(now);
  return age(now) && std::abs(u.v_mps) < kTiny_mps && std::abs(u.omega_radps) < kTiny_radps;
}

void CommandWatch::list(CounterList& out) const {
  guard_.list("command", out);
  out.emplace_back("command.non_finite", non_finite_);
  out.emplace_back("command.blind", blind_);
  actuator_.list(out);
}

}  // namespace tether
