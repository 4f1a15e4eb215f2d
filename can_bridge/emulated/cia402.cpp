#include "can_bridge/emulated/cia402.hpp"

namespace tether {

EmulatedCia402::EmulatedCia402(const Cia402Config& config, Instant now) {
  for (const std::uint8_t id : config.nodes()) {
    nodes_.push_back(std::make_unique<EmulatedNode>(config, id, now));
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

std::unique_ptr<EmulatedDrivetrain> emulate(const Cia402Config& config, Instant now) {
  return std::make_unique<EmulatedCia402>(config, now);
}

}  // namespace tether
