#include "can_bridge/agilex/config.hpp"
#include "can_bridge/cia402/profile.hpp"
#include "can_bridge/profiles/profiles.hpp"

namespace tether {

std::unique_ptr<DriveProfile> make_drive_profile(const DrivetrainConfig& config,
                                                 const VehicleConfig& vehicle) {
  return std::visit([&](const auto& row) { return make_profile(row, vehicle); }, config);
}

}  // namespace tether
