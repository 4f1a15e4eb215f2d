#include "can_bridge/cia402/stage.hpp"

namespace tether::cia402 {

DrivePhase phase_of(Stage stage) {
  switch (stage) {
    case Stage::idle:
    case Stage::listening:
    case Stage::securing:
    case Stage::configuring:
    case Stage::beating:
    case Stage::activating:
    case Stage::settling:
    case Stage::clearing:
      break;
    case Stage::standby:
      return DrivePhase::standby;
    case Stage::verifying:
    case Stage::enabling:
      return DrivePhase::enabling;
    case Stage::enabled:
      return DrivePhase::enabled;
    case Stage::stopping:
      return DrivePhase::stopping;
    case Stage::faulted:
      return DrivePhase::faulted;
    case Stage::refused:
      return DrivePhase::refused;
  }
  return DrivePhase::starting;
}

}  // namespace tether::cia402
