// Gives every fuzz target its seeds and the empty input. An input that breaks a fact ends the
// program, after its name.
#include "tests/fuzz/replay.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "tests/support/source_dir.hpp"

namespace {

std::vector<std::filesystem::path> seeds_of(std::string_view target) {
  const std::filesystem::path folder =
      tether::in_source("/tests/fuzz/seeds/") + std::string(target);
  std::vector<std::filesystem::path> files;
  if (!std::filesystem::exists(folder)) return files;
  using Options = std::filesystem::directory_options;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(folder, Options::follow_directory_symlink)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

int main() {
  std::size_t inputs = 0;
  for (const FuzzTarget& target : kFuzzTargets) {
    target.try_input({});
    for (const auto& file : seeds_of(target.name)) {
      std::ifstream in(file, std::ios::binary);
      const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
      fmt::print("{} {}\n", target.name, file.filename().string());
      std::fflush(stdout);
      target.try_input(bytes);
      ++inputs;
    }
  }
  fmt::print("{} seeds of {} targets, none that breaks a fact\n", inputs, kFuzzTargets.size());
  return inputs > 0 ? 0 : 1;
}
