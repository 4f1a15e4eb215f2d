#pragma once

#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>

namespace tether {

/// Passes a system call's result through, or throws what was attempted and why it failed.
inline int check_system_call(const std::string& attempt, int result) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), attempt);
  return result;
}

/// The user's input cannot be used: bad option, scenario, URL or file. Programs print what() and
/// exit with 2; every other exception exits with 1.
class UsageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace tether
