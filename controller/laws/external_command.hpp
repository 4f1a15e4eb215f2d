#pragma once

#include <cctype>
#include <functional>
#include <string>

namespace tether {

/// controller.command with `value_of(NAME)` in place of each {NAME}, a word of small letters in
/// braces. Other braces stay as they are.
inline std::string filled_in(const std::string& command,
                             const std::function<std::string(const std::string& name)>& value_of) {
  std::string filled;
  for (std::size_t i = 0; i < command.size(); ++i) {
    std::size_t end = i + 1;
    while (end < command.size() && std::islower(static_cast<unsigned char>(command[end])) != 0)
      ++end;
    const bool is_place =
        command[i] == '{' && end > i + 1 && end < command.size() && command[end] == '}';
    if (is_place) {
      filled += value_of(command.substr(i + 1, end - i - 1));
      i = end;
    } else {
      filled += command[i];
    }
  }
  return filled;
}

}  // namespace tether
