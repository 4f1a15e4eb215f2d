#include "common/actuator/actuator.hpp"

#include <algorithm>
#include <utility>

namespace tether {
namespace {

StopLimits stop_limits(const ActuatorSettings& config, const VehicleConfig& vehicle) {
  return {config.deceleration_mps2, config.yaw_deceleration_radps2,
          vehicle.max_wheel_acceleration_mps2, vehicle.max_wheel_speed_mps, vehicle.track_m};
}

}  // namespace

Actuator::Actuator(const ActuatorSettings& config, const VehicleConfig& vehicle,
                   const StreamGuard::Config& guard)
    : timeout_(from_seconds(config.timeout_s)),
      policy_(&kind_of(config)),
      limits_(stop_limits(config, vehicle)),
      plans_(limits_, guard),
      config_(config) {}

void Actuator::on_command(Instant now, const Twist& command) {
  command_ = command;
  arrival_ = now;
  any_command_ = true;
  plans_.clear();
}

bool Actuator::on_plan(Instant now, PlanSource source, Plan plan) {
  if (!takes_plans()) {
    ++unasked_plans_;
    return false;
  }
  return plans_.offer(now, source, std::move(plan)) == PlanFate::accepted;
}

Twist Actuator::in_force(Instant now) const {
  if (!plans_.empty()) {
    if (const auto planned = plans_.in_force(now)) return *planned;
  }
  return command_in_force(now);
}

Twist Actuator::command_in_force(Instant now) const {
  const Duration since = now - arrival_ - timeout_;
  if (policy_->after_timeout == nullptr || since < Duration{0}) return command_;
  return policy_->after_timeout(command_, since, config_, limits_);
}

Instant Actuator::unchanged_until(Instant now) const {
  const Instant by_plans = plans_.unchanged_until(now);
  if (policy_->after_timeout == nullptr || plans_.end(now)) return by_plans;
  if (now - arrival_ < timeout_) return std::min(by_plans, arrival_ + timeout_);
  return stands_still(command_in_force(now)) ? by_plans : now;
}

std::optional<Duration> Actuator::plan_age(Instant now) const {
  if (const auto end = plans_.end(now)) return std::max(Duration{0}, now - *end);
  if (!any_command_ && !plans_.empty()) return Duration{0};
  return std::nullopt;
}

void Actuator::list(CounterList& out) const {
  if (takes_plans()) {
    plans_.list(out);
  } else if (unasked_plans_ > 0) {
    out.emplace_back("plan.unasked", unasked_plans_);
  }
}

}  // namespace tether
