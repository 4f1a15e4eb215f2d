#include "sim/actuator.hpp"

namespace tether {

Actuator::Actuator(const Scenario::Actuator& config)
    : has_timeout_(config.policy == Scenario::Actuator::Policy::zero),
      timeout_(from_seconds(config.timeout_s)) {}

void Actuator::on_command(Instant now, const Twist& command) {
  command_ = command;
  arrival_ = now;
}

Twist Actuator::in_force(Instant now) const {
  const bool stale = has_timeout_ && now - arrival_ >= timeout_;
  return stale ? Twist{} : command_;
}

}  // namespace tether
