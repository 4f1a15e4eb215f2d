#include "controller/laws/roll_out.hpp"

namespace tether {

Twist RollOut::step(const Twist* wish) {
  const PathPoint next = path_.at(start_s_ + static_cast<double>(++steps_) * step_s_);
  const Twist wanted = wish != nullptr ? *wish : feedback_wish(next);
  const Twist command =
      model_.command_for(state_, model_.reachable(state_.rim, wanted, step_s_), step_s_);
  model_.advance(state_, command, step_s_);
  reference_ = next;
  return command;
}

Twist RollOut::feedback_wish(const PathPoint& next) const {
  PathPoint middle = reference_;
  middle.v_mps = 0.5 * (reference_.v_mps + next.v_mps);
  middle.omega_radps = 0.5 * (reference_.omega_radps + next.omega_radps);
  return feedback_.command(state_.pose, middle);
}

}  // namespace tether
