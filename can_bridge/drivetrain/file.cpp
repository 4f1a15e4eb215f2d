#include "can_bridge/drivetrain/file.hpp"

#include <fmt/format.h>

namespace tether {

std::optional<TomlReader> DrivetrainFile::section(const std::string& name, const Keys& keys) const {
  const toml::node* const node = top_.find(name);
  if (node == nullptr) return std::nullopt;
  return reader(name, *node, keys);
}

TomlReader DrivetrainFile::required_section(const std::string& name, const Keys& keys,
                                            const std::string& allowed) const {
  return reader(name, top_.require(name, allowed), keys);
}

void DrivetrainFile::each(const std::string& name, const Keys& keys,
                          const std::function<void(const TomlReader&)>& read) const {
  const toml::node* const node = top_.find(name);
  if (node == nullptr) return;
  const auto* const array = node->as_array();
  if (array == nullptr) {
    top_.refuse_at(node->source().begin.line,
                   fmt::format("{0} is a list: write [[{0}]], with two brackets", name));
  }
  for (const toml::node& element : *array) read(reader(name, element, keys));
}

TomlReader DrivetrainFile::reader(const std::string& name, const toml::node& node,
                                  const Keys& keys) const {
  const auto* const table = node.as_table();
  if (table == nullptr) top_.refuse(name, node, fmt::format("a section [{}]", name));
  return {*table, top_.file(), name, keys};
}

void read_feedback_and_boot(const TomlReader& drives, DrivetrainCommon& config) {
  drives.integer("feedback_timeout_ms", config.feedback_timeout_ms, 20, 1000,
                 "age of a wheel's feedback that stops the vehicle");
  drives.integer("boot_timeout_ms", config.boot_timeout_ms, 100, 60'000,
                 "from reset to boot-up message");
}

void read_step_and_standstill(const TomlReader& drives, DrivetrainCommon& config) {
  drives.integer("step_timeout_ms", config.step_timeout_ms, 50, 60'000,
                 "for each change of a drive's state");
  drives.number("standstill_radps", config.standstill_radps, 1e-4, 1.0,
                "wheels slower than this stand");
}

}  // namespace tether
