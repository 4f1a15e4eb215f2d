#pragma once

#include <stdexcept>

namespace tether {

/// The user's input cannot be used: bad option, scenario, URL or file. Programs print what() and
/// exit with 2; every other exception exits with 1.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tether
