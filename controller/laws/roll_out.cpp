#include "controller/laws/roll_out.hpp"

namespace tether {

Twist RollOut::step(const Twist* wish) {
  const Twist wanted = wish != nullptr ? *wish : feedback_wish();
  const Twist command = model_.pursue(state_, heading_, wanted, step_s_);
  ++steps_;
  return command;
}

Twist RollOut::feedback_wish() const {
  const PathPoint& next = path_[steps_ + 1];
  PathPoint middle = reference();
  middle.v_mps = 0.5 * (middle.v_mps + next.v_mps);
  middle.omega_radps = 0.5 * (middle.omega_radps + next.omega_radps);
  return feedback_.command(state_.pose, heading_, middle);
}

}  // namespace tether
