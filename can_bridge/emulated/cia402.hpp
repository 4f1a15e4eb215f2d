#pragma once

#include <array>
#include <memory>
#include <vector>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/emulated/drivetrain.hpp"
#include "can_bridge/emulated/node.hpp"

namespace tether {

/// The CiA 402 drives that a drivetrain file describes: one CANopen device for each node id, with
/// one or two axes (node.hpp says what each does). Objects, sizes, scales, signs and
/// watchdogs are the file's; ramps are in units of target velocity per second.
///
/// Before the first set_wheels() the wheels stand. Where a wheel is at that call is where its
/// encoder counts from.
class EmulatedCia402 final : public EmulatedDrivetrain {
 public:
  /// Powered on at `now`; the boot-up messages come EmulatedNode::kBootTime later.
  EmulatedCia402(const Cia402Config& config, Instant now);

  /// All 11-bit data frames: SDO may give a PDO any identifier.
  std::vector<CanFilter> filters() const override { return {{.id = 0, .mask = 0}}; }
  void on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) override;
  void tick(Instant now, std::vector<CanFrame>& out) override;
  void set_wheels(const WheelStates& wheels) override;
  std::array<double, 2> wheel_targets_radps() const override;
  /// A fault of an unknown node does nothing.
  void inject(const DriveFault& fault, Instant now) override;
  void list(CounterList& out) const override;

  /// In the order in which the axes name them, left first.
  const std::vector<std::unique_ptr<EmulatedNode>>& nodes() const { return nodes_; }

 private:
  std::vector<std::unique_ptr<EmulatedNode>> nodes_;
};

/// The drives, powered on at `now`.
std::unique_ptr<EmulatedDrivetrain> emulate(const Cia402Config& config, Instant now);

}  // namespace tether
