#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// How many letters have to be put in, taken out or replaced to make one of the other
/// (Levenshtein).
std::size_t edit_distance(std::string_view a, std::string_view b);

/// The one that is written most like `word`, the first of several; `names` is not empty.
const std::string& nearest_name(const std::vector<std::string>& names, std::string_view word);

}  // namespace tether
