#include "can_bridge/emulated/cia402.hpp"

#include <algorithm>

namespace tether {

EmulatedCia402::EmulatedCia402(const DrivetrainConfig& config, Instant now) {
  for (const AxisConfig& axis : config.axes) {
    const bool known = std::any_of(nodes_.begin(), nodes_.end(),
                                   [&axis](const auto& node) { return node->id() == axis.node; });
    if (!known) nodes_.push_back(std::make_unique<EmulatedNode>(config, axis.node, now));
  }
}

void EmulatedCia402::on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) {
  for (const auto& node : nodes_) node->on_frame(frame, now, out);
}

void EmulatedCia402::tick(Instant now, std::vector<CanFrame>& out) {
  for (const auto& node : nodes_) node->tick(now, out);
}

void EmulatedCia402::set_wheels(const WheelStates& wheels) {
  for (const auto& node : nodes_) node->set_wheels(wheels);
}

std::array<double, 2> EmulatedCia402::wheel_targets_radps() const {
  std::array<double, 2> targets_radps{};
  for (const auto& node : nodes_) node->put_wheel_targets(targets_radps);
  return targets_radps;
}

void EmulatedCia402::inject(const DriveFault& fault, Instant now) {
  for (const auto& node : nodes_) {
    if (fault.node == 0 || fault.node == node->id()) node->inject(fault, now);
  }
}

void EmulatedCia402::list(CounterList& out) const {
  for (const auto& node : nodes_) node->list(out);
}

}  // namespace tether
