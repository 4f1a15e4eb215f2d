#include "can_bridge/drive_profile.hpp"

#include "can_bridge/agilex_v2_profile.hpp"
#include "can_bridge/cia402_profile.hpp"
#include "can_bridge/drivetrain_config.hpp"
#include "common/vehicle_config.hpp"

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

std::unique_ptr<DriveProfile> make_drive_profile(const DrivetrainConfig& config,
                                                 const VehicleConfig& vehicle) {
  if (config.profile == DrivetrainConfig::Profile::agilex_v2) {
    return std::make_unique<AgilexV2Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
  }
  return std::make_unique<Cia402Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
}

}  // namespace tether
