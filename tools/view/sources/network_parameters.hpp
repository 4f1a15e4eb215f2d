#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/scenario/scenario.hpp"
#include "netem/channel/change.hpp"
#include "tools/view/server/parameter.hpp"

namespace tether {

/// Editable properties of a parameter, for a page that shows it as a slider, a switch or a list.
struct ParameterDescription {
  std::string name;
  /// "number", "whole number", "switch", "choice", "list" (of numbers), "rows" (lists of numbers,
  /// as text), "text"; of what is only to be looked at, "texts".
  std::string kind;
  std::optional<double> low, high;   ///< range of numbers; none: any
  std::vector<std::string> choices;  ///< choices, if it is a choice
  std::string allowed;               ///< in words
  std::string meaning;               ///< with unit
  bool can_be_set = true;
};

/// The settings of a relay's channel as parameters: "network.uplink.prr" is what NET/SET calls
/// "uplink.prr". It knows all keys and what the relay has said of them.
///
/// Files cannot be set: a page has no business with the names of files here.
class NetworkParameters {
 public:
  static constexpr std::string_view kPrefix = "network.";
  /// A parameter with the names of those that have an effect, as the others are; read-only.
  static constexpr std::string_view kInEffect = "network.in_effect";

  /// Parameters of `channel`.
  explicit NetworkParameters(const ChannelSettings& channel = {});

  /// `settings`: what the relay has answered; what of it is not understood is left as it was. All:
  /// whatever it does not name has its default.
  void take(const std::vector<ChannelSetting>& settings, bool all);

  /// All, and network.in_effect.
  std::vector<Parameter> values() const;
  const std::vector<ParameterDescription>& descriptions() const { return descriptions_; }

  static bool owns(std::string_view name) { return name.starts_with(kPrefix); }

  /// Settings in the form of NET/SET, "KEY=VALUE". Throws UsageError that names the parameter if
  /// its value is none for it, or must not be set.
  std::vector<std::string> settings(const std::vector<Parameter>& parameters) const;
  static constexpr std::size_t kMostAtOnce = 1000;

 private:
  void describe();
  std::string setting(const Parameter& parameter) const;

  Scenario scenario_;  ///< its [channel]
  std::vector<ParameterDescription> descriptions_;
  std::map<std::string, std::size_t, std::less<>> places_;  ///< in descriptions_
};

}  // namespace tether
