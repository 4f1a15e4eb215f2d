#include "can_bridge/profiles/emulation.hpp"

#include "can_bridge/emulated/node.hpp"

namespace tether {

std::unique_ptr<EmulatedDrivetrain> make_emulated_drivetrain(const DrivetrainConfig& config,
                                                             Instant now) {
  return std::visit([now](const auto& row) { return emulate(row, now); }, config);
}

}  // namespace tether
