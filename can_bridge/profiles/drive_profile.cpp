#include "can_bridge/agilex/v2_profile.hpp"
#include "can_bridge/cia402/profile.hpp"
#include "can_bridge/profiles/profiles.hpp"

namespace tether {

std::unique_ptr<DriveProfile> make_drive_profile(const DrivetrainConfig& config,
                                                 const VehicleConfig& vehicle) {
  if (config.profile == DrivetrainConfig::Profile::agilex_v2) {
    return std::make_unique<AgilexV2Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
  }
  return std::make_unique<Cia402Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
}

}  // namespace tether
