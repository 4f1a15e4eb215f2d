#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "can_bridge/drivetrain/config.hpp"
#include "can_bridge/drivetrain/transmit_rules.hpp"
#include "common/base/time.hpp"

namespace tether {

class DriveProfile;
class DrivetrainFile;
class EmulatedDrivetrain;
struct VehicleConfig;

/// A chassis that speaks the AgileX protocol, version 2, as described in a file of drivetrains/
/// (docs/howto/drivetrain.md). The functions are its row in profiles/profiles.hpp.
struct AgilexV2Config : DrivetrainCommon {
  static constexpr const char* kProfile = "agilex_v2";
  static constexpr std::array kSections{"drives", "chassis"};

  // The chassis' own figures, by which it turns twists into wheel speeds.
  double chassis_wheel_radius_m = 0.4;
  double chassis_track_m = 1.2;

  static AgilexV2Config read(const DrivetrainFile& file);
  /// Motion (0x111, setpoints in its bytes 0…7), control mode (0x421), clear errors (0x441).
  TransmitRules transmit_rules() const;
  /// Its only watchdog is the chassis' own, of 500 ms: any control cycle will do.
  void check_cycle(double /*cycle_ms*/) const {}
  void check_deceleration(double /*mps2*/, double /*wheel_radius_m*/) const {}
  OwnStop own_stop(double /*wheel_radius_m*/) const {
    return {std::nullopt, std::chrono::milliseconds{500}};
  }
  /// It has no node ids.
  std::vector<std::uint8_t> nodes() const { return {}; }
};

/// Its profile; wheel radius and track of the vehicle must agree with the chassis'.
std::unique_ptr<DriveProfile> make_profile(const AgilexV2Config& config,
                                           const VehicleConfig& vehicle);

/// The chassis, powered on at `now` (emulated_v2.hpp says what it does).
std::unique_ptr<EmulatedDrivetrain> emulate(const AgilexV2Config& config, Instant now);

}  // namespace tether
