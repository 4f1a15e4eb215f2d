#include "doors/ros2/command_gate.hpp"

namespace tether {

std::optional<Twist> CommandGate::take(Instant now, std::uint64_t publisher,
                                       const std::optional<RosCommand>& command) {
  watch_.heard(now, publisher);
  const auto refuse = [](std::int64_t& counter) {
    ++counter;
    return std::optional<Twist>{};
  };
  if (several(now)) return refuse(several_);
  if (!command) return refuse(undecodable_);
  if (!is_usable(command->twist) || !is_usable(command->other)) return refuse(non_finite_);
  if (command->other != 0.0) return refuse(sideways_);
  if (command->header) {
    const auto& [stamp_ns, frame_id] = *command->header;
    if (!frame_id.empty() && frame_id != config_.frame) return refuse(wrong_frame_);
    const Duration age = now - kStart - std::chrono::nanoseconds{stamp_ns - config_.shift_ns};
    if (age > config_.max_age) return refuse(old_);
    if (age < -config_.max_age) return refuse(from_future_);
  }
  ++accepted_;
  return command->twist;
}

void CommandGate::list(CounterList& out) const {
  out.emplace_back("ros2.accepted", accepted_);
  out.emplace_back("ros2.several", several_);
  out.emplace_back("ros2.undecodable", undecodable_);
  out.emplace_back("ros2.non_finite", non_finite_);
  out.emplace_back("ros2.sideways", sideways_);
  out.emplace_back("ros2.wrong_frame", wrong_frame_);
  out.emplace_back("ros2.old", old_);
  out.emplace_back("ros2.from_future", from_future_);
}

}  // namespace tether
