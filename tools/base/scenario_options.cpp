#include "tools/base/scenario_options.hpp"

#include <fmt/format.h>

namespace tether {

std::vector<std::string> ScenarioOptions::overrides() const {
  std::vector<std::string> all = set;
  if (seed) all.push_back(fmt::format("run.seed={}", *seed));
  return all;
}

CLI::Option* add_scenario(CLI::App& command, ScenarioOptions& options) {
  CLI::Option* const file = command.add_option("scenario", options.file, "scenario file (TOML)");
  command
      .add_option("--set", options.set,
                  "override a scenario key: KEY=VALUE (repeatable; channel.X sets both ways)")
      ->allow_extra_args(false);
  return file;
}

void add_seed(CLI::App& command, ScenarioOptions& options) {
  command.add_option("--seed", options.seed, "override run.seed")
      ->check(CLI::Range(std::int64_t{0}, INT64_MAX));
}

}  // namespace tether
