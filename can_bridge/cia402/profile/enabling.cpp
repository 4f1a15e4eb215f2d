#include "can_bridge/cia402/profile/enabling.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace tether::cia402 {
namespace {

using canopen::DriveState;

constexpr int kTop = 3;

/// How far a state is on the way to OperationEnabled; −1 if it is not on that way.
int height(std::optional<DriveState> state) {
  if (!state) return -1;
  switch (*state) {
    case DriveState::switch_on_disabled:
      return 0;
    case DriveState::ready_to_switch_on:
      return 1;
    case DriveState::switched_on:
      return 2;
    case DriveState::operation_enabled:
      return kTop;
    case DriveState::not_ready:
    case DriveState::quick_stop_active:
    case DriveState::fault_reaction:
    case DriveState::fault:
      break;
  }
  return -1;
}

}  // namespace

void Enabling::begin() {
  d_.stage.enter(Stage::enabling);
  climbed_ = {-1, -1};
}

std::optional<Fault> Enabling::tick(Instant now) {
  bool all_enabled = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    const int reached = height(axis.confirmed_state());
    if (d_.stage.elapsed(now) == Duration{0} || reached > climbed_[i]) {
      climbed_[i] = std::max(climbed_[i], reached);
      climbed_at_[i] = now;
    }
    if (reached == kTop) continue;
    all_enabled = false;
    const bool dropped = climbed_[i] == kTop;
    if (dropped || now - climbed_at_[i] >= d_.step_timeout()) {
      return Fault{fmt::format(
          "{}: {} {} after controlword 0x{:04X}{}: check its main supply, STO and enable inputs",
          axis.name(), dropped ? "fell back to" : "is still in", canopen::to_string(axis.state()),
          axis.controlword(), dropped ? "" : fmt::format(" for {} ms", d_.config.step_timeout_ms))};
    }
  }
  if (all_enabled) d_.stage.enter(Stage::enabled);
  return std::nullopt;
}

}  // namespace tether::cia402
