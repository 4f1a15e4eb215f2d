#include "can_bridge/profiles/emulation.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// A drivetrain file; what is taken has rules, a profile and an emulation.
void try_input(std::span<const std::uint8_t> input) {
  takes([&] {
    const DrivetrainConfig config = parse_drivetrain(text_of(input), "drivetrain.toml");
    takes([&] { check_cycle(config, 20.0); });
    must(!transmit_rules(config).frames.empty(), "a bridge may send something");
    must(make_drive_profile(config, VehicleConfig{}) != nullptr, "a drivetrain has a profile");
    must(make_emulated_drivetrain(config, kStart) != nullptr, "a drivetrain has an emulation");
  });
}

}  // namespace tether::fuzzing
