#include "controller/node/command_sending.hpp"

#include <algorithm>
#include <cmath>
#include <variant>

namespace tether {
namespace {

bool stands(const LawOutput& decision) {
  if (const auto* plan = std::get_if<Plan>(&decision)) return plan->is_stop();
  const auto& twist = std::get<Twist>(decision);
  return twist.v_mps == 0.0 && twist.omega_radps == 0.0;
}

/// Mean twist of `plan` from `t` on for `during`, which is at most one of its steps.
Twist mean(const Plan& plan, Instant t, Duration during) {
  const Twist &first = plan.at(t), &then = plan.at(t + during);
  const Duration into = (t - plan.start) % plan.step;
  const Duration second = std::max(Duration{0}, into + during - plan.step);
  const double share = to_seconds(second) / to_seconds(during);
  return {first.v_mps + share * (then.v_mps - first.v_mps),
          first.omega_radps + share * (then.omega_radps - first.omega_radps)};
}

}  // namespace

CommandSending::CommandSending(const ControllerSettings& settings)
    : delta_mps_(settings.send_delta_mps),
      delta_radps_(settings.send_delta_radps),
      max_age_(from_seconds(settings.send_max_age_s)) {
  if (settings.trigger == ControllerSettings::Trigger::timer) {
    period_ = from_seconds(1.0 / settings.rate_hz);
  }
}

bool CommandSending::is_due(Instant now, const LawOutput& decision, bool stopped,
                            const SeenPose* newest) {
  const auto is_late = [&] {
    const Duration age = now - last_at_;
    return period_ > Duration{0} ? age + period_ > max_age_ : age >= max_age_;
  };
  if (!stopped && last_ && !is_late() && !is_missed(newest) && !differs(decision)) return false;
  last_ = decision;
  last_at_ = now;
  return true;
}

bool CommandSending::is_missed(const SeenPose* newest) const {
  const auto* sent = std::get_if<Plan>(&*last_);
  return sent != nullptr && newest != nullptr && newest->stamp >= sent->start &&
         newest->plan_id != sent->name.id;
}

bool CommandSending::differs(const Twist& a, const Twist& b) const {
  return std::abs(a.v_mps - b.v_mps) > delta_mps_ ||
         std::abs(a.omega_radps - b.omega_radps) > delta_radps_;
}

bool CommandSending::differs(const LawOutput& decision) const {
  if (decision.index() != last_->index() || stands(decision) != stands(*last_)) return true;
  if (const auto* plan = std::get_if<Plan>(&decision))
    return differs(*plan, std::get<Plan>(*last_));
  return differs(std::get<Twist>(decision), std::get<Twist>(*last_));
}

bool CommandSending::differs(const Plan& plan, const Plan& sent) const {
  if (plan.start < sent.start || plan.start + plan.step > sent.end() || plan.step != sent.step) {
    return true;
  }
  Instant t = plan.start;
  for (const Twist& twist : plan.twists) {
    if (t + plan.step > sent.end()) break;
    if (differs(twist, mean(sent, t, plan.step))) return true;
    t += plan.step;
  }
  return false;
}

}  // namespace tether
