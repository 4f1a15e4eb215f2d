#pragma once

#include <CLI/CLI.hpp>

namespace tether {

/// CLI::Range for numbers, which also refuses NaN: that is neither below nor above anything.
inline CLI::Validator number_between(double low, double high) {
  CLI::Validator range = CLI::Range(low, high);
  return range & CLI::Validator(
                     [](std::string& text) {
                       return CLI::detail::to_lower(text).find("nan") == std::string::npos
                                  ? std::string{}
                                  : "Value " + text + " is not a number";
                     },
                     "");
}

}  // namespace tether
