#include "can_bridge/commission/record.hpp"
#include "can_bridge/profiles/emulation.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// A drivetrain file; what is taken has rules, a profile and an emulation. And a record of
/// commissioning; what is taken is read as it is written.
void try_input(std::span<const std::uint8_t> input) {
  takes([&] {
    const DrivetrainConfig config = parse_drivetrain(text_of(input), "drivetrain.toml");
    takes([&] { check_cycle(config, 20.0); });
    must(!transmit_rules(config).frames.empty(), "a bridge may send something");
    must(make_drive_profile(config, VehicleConfig{}) != nullptr, "a drivetrain has a profile");
    must(make_emulated_drivetrain(config, kStart) != nullptr, "a drivetrain has an emulation");
  });
  takes([&] {
    const CommissionRecord record = parse_record(text_of(input), "record.toml");
    const std::string text = to_toml(record);
    must(to_toml(parse_record(text, "record.toml")) == text, "a record is read as it is written");
    must(differences(record.objects, record.objects).empty(),
         "a record does not differ from itself");
  });
}

}  // namespace tether::fuzzing
