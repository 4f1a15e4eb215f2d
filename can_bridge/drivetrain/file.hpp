#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "can_bridge/drivetrain/config.hpp"
#include "common/base/toml_reader.hpp"

namespace tether {

/// A drivetrain file while a profile reads its part of it. Whatever does not fit is refused with a
/// UsageError that names file, line, key and what is allowed.
class DrivetrainFile {
 public:
  using Keys = std::vector<std::string>;

  /// `top` must outlive it.
  explicit DrivetrainFile(const TomlReader& top) : top_(top) {}

  /// For messages.
  const std::string& name() const { return top_.file(); }

  /// The section [name] with these keys and no others; nullopt if there is none.
  std::optional<TomlReader> section(const std::string& name, const Keys& keys) const;
  /// The same for a section that must be there: `allowed` says what is missing.
  TomlReader required_section(const std::string& name, const Keys& keys,
                              const std::string& allowed) const;
  /// Hands over each section of the list [[name]].
  void each(const std::string& name, const Keys& keys,
            const std::function<void(const TomlReader&)>& read) const;

 private:
  TomlReader reader(const std::string& name, const toml::node& node, const Keys& keys) const;

  const TomlReader& top_;
};

/// Reads feedback_timeout_ms and boot_timeout_ms of [drives], which all profiles have.
void read_feedback_and_boot(const TomlReader& drives, DrivetrainCommon& config);
/// Reads step_timeout_ms and standstill_radps of [drives], which all profiles have.
void read_step_and_standstill(const TomlReader& drives, DrivetrainCommon& config);

}  // namespace tether
