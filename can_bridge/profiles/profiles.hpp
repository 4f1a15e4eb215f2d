#pragma once

#include <memory>

#include "can_bridge/drivetrain/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/emulated/drivetrain.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// The profile that `config` names. Wheel radius and track come from the vehicle.
std::unique_ptr<DriveProfile> make_drive_profile(const DrivetrainConfig& config,
                                                 const VehicleConfig& vehicle);

/// Emulates whatever drivetrain `config` describes.
std::unique_ptr<EmulatedDrivetrain> make_emulated_drivetrain(const DrivetrainConfig& config,
                                                             Instant now);

}  // namespace tether
