#include "common/scenario/scenario.hpp"

#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

/// A scenario, whose last line is an override, too; what it resolves to is a scenario that resolves
/// to itself.
void try_input(std::span<const std::uint8_t> input) {
  const std::string text = text_of(input);
  const std::string override = text.substr(text.rfind('\n') + 1);
  for (const bool overridden : {false, true}) {
    takes([&] {
      const auto overrides = overridden ? std::vector{override} : std::vector<std::string>{};
      const std::string resolved =
          to_toml(parse_scenario(overridden ? "" : text, "scenario.toml", overrides));
      must(to_toml(parse_scenario(resolved, "resolved.toml")) == resolved,
           "a resolved scenario resolves to itself");
    });
  }
}

}  // namespace tether::fuzzing
