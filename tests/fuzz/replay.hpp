#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

/// A fuzz target: its name, which is that of its folder in seeds/, and what it does with an input.
struct FuzzTarget {
  std::string_view name;
  void (*try_input)(std::span<const std::uint8_t> input);
};

extern const std::vector<FuzzTarget> kFuzzTargets;
