#include "can_bridge/cia402/profile/clearing.hpp"

namespace tether::cia402 {

void Clearing::begin() {
  d_.stage.enter(Stage::clearing);
  edge_ = false;
}

std::uint16_t Clearing::controlword() const {
  return edge_ ? canopen::kControlFaultReset : canopen::kControlDisableVoltage;
}

std::optional<Fault> Clearing::tick(Instant now) {
  std::optional<std::size_t> faulty;
  bool ready = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (!axis.in_fault()) continue;
    faulty = faulty.value_or(i);
    ready = ready && axis.confirmed_state() == canopen::DriveState::fault &&
            (axis.controlword() & canopen::kControlFaultReset) == 0;
  }
  if (!faulty) {
    for (Axis& axis : d_.axes) axis.on_emergency(canopen::kEmcyReset);
    d_.stage.enter(Stage::settling);
  } else if (!edge_ && ready) {
    edge_ = true;
    d_.stage.restart(now);
  } else if (d_.stage.elapsed(now) >= d_.step_timeout()) {
    return fault_of_axis(d_.axes, *faulty, " cannot be reset");
  }
  return std::nullopt;
}

}  // namespace tether::cia402
