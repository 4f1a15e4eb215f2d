#include "can_bridge/cia402/profile/supervision.hpp"

#include <fmt/format.h>

#include "can_bridge/cia402/startup.hpp"

namespace tether::cia402 {
namespace {

using canopen::DriveState;

bool powered(std::optional<DriveState> state) {
  return state == DriveState::switched_on || state == DriveState::operation_enabled ||
         state == DriveState::quick_stop_active;
}

}  // namespace

std::optional<Fault> watch(Drives& drives, Instant now) {
  std::optional<Fault> first;
  if (drives.supervised()) {
    for (Node& node : drives.nodes) {
      if (now - node.heartbeat_stamp < drives.heartbeat_timeout()) continue;
      node.state.reset();
      if (first) continue;
      first = Fault{fmt::format("{}: no heartbeat for {} ms: check its supply and the CAN plug",
                                node.name, drives.config.drive_heartbeat_timeout_ms),
                    true};
    }
  }
  const Stage stage = drives.stage.stage();
  if (first || stage < Stage::verifying || stage > Stage::enabled) return first;
  for (std::size_t i = 0; i < drives.axes.size(); ++i) {
    if (drives.axes[i].fresh(now)) continue;
    return Fault{drives.axes.feedback_text(i), false, Fault::Cause::feedback};
  }
  return std::nullopt;
}

std::optional<Fault> check_axis(const Drives& drives, std::size_t i) {
  const Axis& axis = drives.axes[i];
  const Stage stage = drives.stage.stage();
  if (!drives.supervised() || stage == Stage::faulted || stage == Stage::clearing) {
    return std::nullopt;
  }
  if (axis.in_fault()) return fault_of_axis(drives.axes, i);
  const std::int64_t mode = axis.mode().value_or(kProfileVelocity);
  const bool not_shown_yet =
      mode == 0 && stage != Stage::enabled && drives.nodes.show_mode_late(axis.node());
  if (mode != kProfileVelocity && !not_shown_yet) return wrong_mode(axis);
  if (stage == Stage::enabled && axis.state() != DriveState::operation_enabled) {
    return Fault{
        fmt::format("{}: went from OperationEnabled to {} unasked: check its main supply, "
                    "STO and enable inputs",
                    axis.name(), canopen::to_string(axis.state()))};
  }
  if ((stage == Stage::standby || stage == Stage::verifying) && powered(axis.confirmed_state())) {
    return Fault{fmt::format("{}: is in {} unasked: who switched it on?", axis.name(),
                             canopen::to_string(axis.state()))};
  }
  return std::nullopt;
}

Fault wrong_mode(const Axis& axis) {
  const std::int64_t mode = axis.mode().value_or(0);
  return {
      fmt::format("{}: mode of operation is {}, not 3 (profile velocity): {}", axis.name(), mode,
                  mode != 0 ? "another tool changed it?"
                            : "the drive shows none. If its mode display blinks, leave "
                              "mode_display out of the TPDOs"),
      true};
}

}  // namespace tether::cia402
