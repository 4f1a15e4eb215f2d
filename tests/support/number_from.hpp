#pragma once

#include <cstdint>
#include <cstdlib>

namespace tether::test {

/// What this variable of the environment says, as how many runs a test is to make.
inline std::uint64_t number_from(const char* variable, std::uint64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

}  // namespace tether::test
