#include "can_bridge/emulated_drivetrain.hpp"

#include "can_bridge/drivetrain_config.hpp"
#include "can_bridge/emulated_agilex_v2.hpp"
#include "can_bridge/emulated_cia402.hpp"

namespace tether {

std::unique_ptr<EmulatedDrivetrain> make_emulated_drivetrain(const DrivetrainConfig& config,
                                                             Instant now) {
  if (config.profile == DrivetrainConfig::Profile::agilex_v2) {
    return std::make_unique<EmulatedAgilexV2>(config, now);
  }
  return std::make_unique<EmulatedCia402>(config, now);
}

}  // namespace tether
