#include "can_bridge/cia402/profile/enabling.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/cia402/profile/supervision.hpp"

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
  d_.stage.enter(Stage::verifying);
  for (Node& node : d_.nodes) node.read_back.begin(node.startup.confirmed());
}

std::optional<Fault> Enabling::tick(Instant now, std::vector<CanFrame>& service) {
  if (d_.stage.stage() == Stage::verifying) {
    if (auto fault = verify(now, service)) return fault;
  }
  return d_.stage.stage() == Stage::enabling ? climb(now) : std::nullopt;
}

std::optional<Fault> Enabling::verify(Instant now, std::vector<CanFrame>& service) {
  bool done = true;
  for (Node& node : d_.nodes) {
    node.read_back.tick(now, service);
    done = done && node.read_back.done();
    if (node.read_back.deviation().empty()) continue;
    return Fault{fmt::format("{}: {} before it was to be enabled: another tool changed it? Reset "
                             "configures the drives again",
                             node.name, node.read_back.deviation()),
                 true};
  }
  if (!done) return std::nullopt;
  d_.stage.enter(Stage::enabling);
  d_.stage.mark(now);
  climbed_ = {-1, -1};
  return std::nullopt;
}

std::optional<Fault> Enabling::climb(Instant now) {
  bool all_enabled = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    const int reached = height(axis.confirmed_state());
    if (d_.stage.elapsed(now) == Duration{0} || reached > climbed_[i]) {
      climbed_[i] = std::max(climbed_[i], reached);
      climbed_at_[i] = now;
    }
    if (reached == kTop && d_.axes.shows_velocity_mode(i)) continue;
    all_enabled = false;
    if (reached == kTop) {
      if (now - climbed_at_[i] < d_.feedback_timeout()) continue;
      return wrong_mode(axis);
    }
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
