#include "common/scenario/scenario.hpp"

#include <filesystem>

#include "common/base/input_file.hpp"
#include "common/base/share.hpp"
#include "common/base/toml_reader.hpp"
#include "common/scenario/loader.hpp"

namespace tether {
namespace {

ScenarioLoader start_from_text(const std::string& toml, const std::string& name) {
  ScenarioLoader loader;
  loader.apply_table(parse_toml(toml, name), "", name);
  loader.end_level(name, std::filesystem::path(name).parent_path());
  return loader;
}

Scenario with_overrides(ScenarioLoader loader, const std::string& name,
                        const std::vector<std::string>& overrides) {
  for (const std::string& text : overrides) loader.apply_override(text, "--set " + text);
  loader.end_level("--set", {});
  return loader.finish(name);
}

}  // namespace

Scenario::Scenario() : Scenario(ScenarioSchema::all()) {}

Scenario::Scenario(std::shared_ptr<const ScenarioSchema> schema) : schema_(std::move(schema)) {
  for (const ScenarioSection& section : schema_->sections()) sections_.push_back(section.defaults);
}

ScenarioLoader start_from_file(const std::string& name) {
  const std::string file = input_named(name);
  return start_from_text(read_input(file, "the scenario file", kMostTomlBytes), file);
}

Scenario parse_scenario(const std::string& toml, const std::string& name,
                        const std::vector<std::string>& overrides) {
  return with_overrides(start_from_text(toml, name), name, overrides);
}

Scenario load_scenario(const std::string& name, const std::vector<std::string>& overrides) {
  const std::string file = input_named(name);
  return with_overrides(start_from_file(file), file, overrides);
}

}  // namespace tether
