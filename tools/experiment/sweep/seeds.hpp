#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/experiment/sweep/section.hpp"

namespace tether {

/// seeds = 50, { first = 201, last = 250 }, or a list, of `section`, which is in `file`. At least
/// one, each once. Throws UsageError that names file, line, key and what is allowed.
std::vector<std::uint64_t> read_seeds(const Section& section, const std::string& file);

/// "201 to 250", or all of them.
std::string seeds_text(const std::vector<std::uint64_t>& seeds);

}  // namespace tether
