#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "netem/link/link_config.hpp"

namespace tether {

inline constexpr Range kDelayRange_ms{0.0, 1e6, false};

/// A link's settings in a scenario, for keys.
struct LinkField {
  std::string prefix;  ///< prefix of its keys: "channel.uplink."
  ScenarioField<LinkConfig> link;

  /// Key of a model's or a stage's own settings: "channel.uplink.<table>.", "channel.uplink." for
  /// "".
  template <class Settings>
  KeyTable<Settings> keys_of(const std::string& table) const {
    return {
        prefix + table + (table.empty() ? "" : "."),
        {[read = link.read](const Scenario& s) -> const Settings& {
           return read(s).own.get<Settings>();
         },
         [write = link.write](Scenario& s) -> Settings& { return write(s).own.get<Settings>(); }}};
  }
};

/// A link's settings when all of them are known, for checks.
struct LoadedLink {
  const LinkConfig& link;
  std::string prefix;         ///< prefix of its keys
  const std::string& source;  ///< for messages

  template <class... Args>
  [[noreturn]] void refuse(fmt::format_string<Args...> text, Args&&... args) const {
    throw UsageError(source + ": " + fmt::format(text, std::forward<Args>(args)...));
  }
};

}  // namespace tether
