#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace tether {

/// Types of a parameter's value; JSON's whole numbers are numbers.
using ParameterValue =
    std::variant<bool, double, std::string, std::vector<double>, std::vector<std::string>>;

/// One thing that can be looked at and, mostly, set by name: "network.uplink.prr".
struct Parameter {
  std::string name;
  std::optional<ParameterValue> value;  ///< none: not set

  bool operator==(const Parameter&) const = default;
};

}  // namespace tether
