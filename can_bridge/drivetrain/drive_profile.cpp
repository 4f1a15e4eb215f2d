#include "can_bridge/drivetrain/drive_profile.hpp"

namespace tether {

const char* to_string(DrivePhase phase) {
  switch (phase) {
    case DrivePhase::starting:
      return "starting";
    case DrivePhase::refused:
      return "refused";
    case DrivePhase::standby:
      return "standby";
    case DrivePhase::enabling:
      return "enabling";
    case DrivePhase::enabled:
      return "enabled";
    case DrivePhase::stopping:
      return "stopping";
    case DrivePhase::faulted:
      return "faulted";
  }
  return "unknown";
}

}  // namespace tether
