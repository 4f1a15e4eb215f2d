#pragma once

#include <concepts>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "can_bridge/agilex/config.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/drivetrain/config.hpp"
#include "can_bridge/drivetrain/drive_profile.hpp"
#include "can_bridge/drivetrain/file.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// A drivetrain, as described in a file of drivetrains/ (docs/howto/drivetrain.md). This list is
/// the table of all drive profiles: each type in it is a row, in its profile's own folder, and
/// offers what ProfileConfig demands. A new profile is one more type here.
using DrivetrainConfig = std::variant<Cia402Config, AgilexV2Config>;

/// Requirements on the row of a profile. A row that lacks something does not compile. Two
/// functions are asked for where they are called, so that the bridge links without emulation and
/// the emulation without profiles; they may be declared beside the row, or elsewhere and included
/// there:
///     std::unique_ptr<DriveProfile> make_profile(const Config&, const VehicleConfig&);
///     std::unique_ptr<EmulatedDrivetrain> emulate(const Config&, Instant now);
template <class Config>
concept ProfileConfig = std::derived_from<Config, DrivetrainCommon> &&
    requires(const Config& config, const DrivetrainFile& file) {
  // Name in files: profile = "cia402".
  { Config::kProfile } -> std::convertible_to<std::string>;
  // The names of its sections; those of other profiles are refused.
  { *std::begin(Config::kSections) } -> std::convertible_to<std::string>;
  // Reads and checks those.
  { Config::read(file) } -> std::same_as<Config>;
  // Frames that the bridge may send, by the description alone.
  { config.transmit_rules() } -> std::same_as<TransmitRules>;
  // Throws UsageError if the control cycle is too slow for the drives' time-outs.
  { config.check_cycle(20.0) } -> std::same_as<void>;
  // Throws UsageError if the drives' own stop is weaker than the bridge's limit.
  { config.check_deceleration(1.5, 0.4) } -> std::same_as<void>;
  // How the drives stop by themselves, at the rim of wheels of this radius.
  { config.own_stop(0.4) } -> std::same_as<OwnStop>;
  // The node ids that a fault can be injected into; empty: it has none.
  { config.nodes() } -> std::same_as<std::vector<std::uint8_t>>;
};

/// Reads a drivetrain file (TOML). Throws UsageError that names file, line, key and what is
/// allowed; also for what cannot work (Cia402Config::read()).
DrivetrainConfig load_drivetrain(const std::string& file);

/// The same from text; `name` stands in for the file in messages.
DrivetrainConfig parse_drivetrain(const std::string& toml, const std::string& name);

/// The profile that `config` names. Wheel radius and track come from the vehicle.
std::unique_ptr<DriveProfile> make_drive_profile(const DrivetrainConfig& config,
                                                 const VehicleConfig& vehicle);
inline TransmitRules transmit_rules(const DrivetrainConfig& config) {
  return std::visit([](const auto& row) { return row.transmit_rules(); }, config);
}
inline void check_cycle(const DrivetrainConfig& config, double cycle_ms) {
  std::visit([=](const auto& row) { row.check_cycle(cycle_ms); }, config);
}
inline void check_deceleration(const DrivetrainConfig& config, double mps2, double wheel_radius_m) {
  std::visit([=](const auto& row) { row.check_deceleration(mps2, wheel_radius_m); }, config);
}
inline OwnStop own_stop(const DrivetrainConfig& config, double wheel_radius_m) {
  return std::visit([=](const auto& row) { return row.own_stop(wheel_radius_m); }, config);
}
inline const std::vector<SafetyInputConfig>& safety_inputs(const DrivetrainConfig& config) {
  return std::visit(
      [](const DrivetrainCommon& row) -> const std::vector<SafetyInputConfig>& {
        return row.safety_inputs;
      },
      config);
}
inline std::vector<std::uint8_t> drive_nodes(const DrivetrainConfig& config) {
  return std::visit([](const auto& row) { return row.nodes(); }, config);
}

}  // namespace tether
