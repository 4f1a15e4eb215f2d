#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/scenario/scenario.hpp"

namespace tether {

/// The scenario that a command works on, as its command line says.
struct ScenarioOptions {
  std::string file;
  std::vector<std::string> set;
  std::optional<std::uint64_t> seed;

  /// `set`, and run.seed if it is given.
  std::vector<std::string> overrides() const;
  Scenario load() const { return load_scenario(file, overrides()); }
};

/// Adds the file and --set. Returns the former, which may be left out unless made required.
CLI::Option* add_scenario(CLI::App& command, ScenarioOptions& options);
/// Adds --seed.
void add_seed(CLI::App& command, ScenarioOptions& options);

}  // namespace tether
