#include "can_bridge/safety/command_watch.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tether {
namespace {

/// Largest v with r·v + v²/(2a) ≤ distance_m, r = reaction, a = deceleration_mps2.
double stopping_from(Duration reaction, double deceleration_mps2, double distance_m) {
  const double r = to_seconds(reaction);
  const double a = deceleration_mps2;
  return a * (std::sqrt(r * r + 2.0 * distance_m / a) - r);
}

}  // namespace

void BlindBudget::update(Instant now, double driven_m, std::optional<Instant> seen) {
  while (driven_.size() > 1 && driven_[1].when + config_.max_time <= now) driven_.pop_front();
  driven_.push_back({now, driven_m});
  if (!seen) {
    blind_ = Duration::max();
    return;
  }
  blind_ = now - *seen;
  // The last sample at or before `seen`: rather too far than too near.
  const auto after =
      std::upper_bound(driven_.begin() + 1, driven_.end(), *seen,
                       [](Instant t, const Sample& sample) { return t < sample.when; });
  blind_m_ = driven_m - (after - 1)->driven_m;
}

double BlindBudget::left_m() const { return std::max(0.0, config_.max_distance_m - blind_m_); }

double BlindBudget::share(const Twist& twist) const {
  const double a = config_.deceleration_mps2;
  const double wheel_a = config_.wheel_deceleration_mps2;
  const double t =
      blind_ < config_.max_time ? to_seconds(config_.max_time - blind_ - config_.reaction) : 0.0;
  const double by_time = std::max(0.0, t);
  const double v = std::abs(twist.v_mps);
  const double h = std::abs(twist.omega_radps) * config_.half_track_m;
  const auto part = [](double limit, double value) {
    return std::abs(value) > limit ? limit / std::abs(value) : 1.0;
  };
  double share = std::min({part(a * by_time, v), part(wheel_a * by_time, v + h),
                           part(config_.yaw_deceleration_radps2 * by_time, twist.omega_radps)});
  if (v > 0.0) {
    // On this curve a stop by the drives takes as far as a deceleration of the vehicle by this.
    const double by_wheels = wheel_a * (h > v ? v / (2.0 * h) : v * v / (v * v + h * h));
    share = std::min({share, part(stopping_from(config_.reaction, a, left_m()), v),
                      part(stopping_from(config_.drives_reaction, by_wheels, left_m()), v)});
  }
  return share;
}

double BlindBudget::speed_beside(double omega_radps) const {
  const double a = config_.wheel_deceleration_mps2;
  const double h = std::abs(omega_radps) * config_.half_track_m;
  double by_wheels = left_m() / (to_seconds(config_.drives_reaction) + h / a);
  if (by_wheels > h) {
    by_wheels = stopping_from(config_.drives_reaction, a, left_m() - h * h / (2.0 * a));
  }
  return std::min(by_wheels, stopping_from(config_.reaction, config_.deceleration_mps2, left_m()));
}

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
