#include "can_bridge/agilex/emulated_v2.hpp"
#include "can_bridge/emulated/cia402.hpp"
#include "can_bridge/profiles/profiles.hpp"
namespace tether {

std::unique_ptr<EmulatedDrivetrain> make_emulated_drivetrain(const DrivetrainConfig& config,
                                                             Instant now) {
  if (config.profile == DrivetrainConfig::Profile::agilex_v2) {
    return std::make_unique<EmulatedAgilexV2>(config, now);
  }
  return std::make_unique<EmulatedCia402>(config, now);
}

}  // namespace tether
