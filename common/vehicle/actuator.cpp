#include "common/vehicle/actuator.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/vehicle/actuator_settings.hpp"

namespace tether {
namespace {

StopLimits stop_limits(const ActuatorSettings& config, const VehicleConfig& vehicle) {
  return {config.deceleration_mps2, config.yaw_deceleration_radps2,
          vehicle.max_wheel_acceleration_mps2, vehicle.max_wheel_speed_mps, vehicle.track_m};
}

Twist decayed(const Twist& from, double since_s, double time_constant_s) {
  constexpr double kTiny_mps = 1e-3, kTiny_radps = 1e-3;
  const double share = std::exp(-since_s / time_constant_s);
  const Twist twist{from.v_mps * share, from.omega_radps * share};
  const bool tiny = std::abs(twist.v_mps) < kTiny_mps && std::abs(twist.omega_radps) < kTiny_radps;
  return tiny ? Twist{} : twist;
}

}  // namespace

Actuator::Actuator(const ActuatorSettings& config, const VehicleConfig& vehicle,
                   const StreamGuard::Config& guard)
    : config_(config),
      limits_(stop_limits(config, vehicle)),
      timeout_(from_seconds(config.timeout_s)),
      plans_(limits_, guard) {}

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
  using Policy = ActuatorSettings::Policy;
  const Duration since = now - arrival_ - timeout_;
  if (config_.policy == Policy::hold || since < Duration{0}) return command_;
  switch (config_.policy) {
    case Policy::hold:
      return command_;
    case Policy::zero:
      return {};
    case Policy::ramp:
    case Policy::horizon:
      return ramp_to_stop(command_, since, limits_);
    case Policy::decay:
      return decayed(within_wheel_speed(command_, limits_), to_seconds(since), config_.decay_s);
  }
  return {};
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
