#pragma once

#include <fmt/format.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <span>
#include <string>
#include <string_view>

#include "common/base/errors.hpp"

namespace tether::fuzzing {

/// Runs a fuzz target with one input: each target defines it. Sanitizers, must() and
/// exceptions end the fuzzer with a report and the input.
void try_input(std::span<const std::uint8_t> input);

/// `fact` must hold, whatever the input.
inline void must(bool holds, std::string_view fact) {
  if (holds) return;
  fmt::print(stderr, "does not hold: {}\n", fact);
  std::abort();
}

/// The input as text.
inline std::string text_of(std::span<const std::uint8_t> input) {
  return {input.begin(), input.end()};
}

/// Whether `use` takes its input. It may refuse it by an `Error` with some text, and by no other
/// exception.
template <class Error = UsageError, class Use>
bool takes(const Use& use) {
  try {
    use();
    return true;
  } catch (const Error& refused) {
    must(!std::string_view(refused.what()).empty(), "a refusal says why");
    return false;
  }
}

}  // namespace tether::fuzzing
