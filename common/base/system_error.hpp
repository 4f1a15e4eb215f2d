#pragma once

#include <cerrno>
#include <string>
#include <system_error>

namespace tether {

/// Passes a system call's result through, or throws what was attempted and why it failed.
inline int check_system_call(const std::string& attempt, int result) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), attempt);
  return result;
}

}  // namespace tether
