#include <fmt/format.h>

#include <cstdio>
#include <cstdlib>

#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

void must(bool holds, std::string_view fact) {
  if (holds) return;
  fmt::print(stderr, "does not hold: {}\n", fact);
  std::abort();
}

}  // namespace tether::fuzzing

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  tether::fuzzing::try_input({data, size});
  return 0;
}
