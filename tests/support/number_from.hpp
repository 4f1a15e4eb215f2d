#pragma once

#include <cstdint>
#include <cstdlib>

namespace tether::test {

/// Number of runs that a test makes, from this environment variable.
inline std::uint64_t number_from(const char* variable, std::uint64_t otherwise) {
  const char* text = std::getenv(variable);
  return text == nullptr ? otherwise : std::strtoull(text, nullptr, 10);
}

}  // namespace tether::test
