#pragma once

#include <memory>

#include "can_bridge/emulated/drivetrain.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/time.hpp"

namespace tether {

/// Emulates whatever drivetrain `config` describes, powered on at `now`.
std::unique_ptr<EmulatedDrivetrain> make_emulated_drivetrain(const DrivetrainConfig& config,
                                                             Instant now);

}  // namespace tether
