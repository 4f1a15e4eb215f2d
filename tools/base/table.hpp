#pragma once

#include <string>
#include <vector>

namespace tether {

/// Prints rows of as many cells as the first has on stdout, in columns as wide as their widest
/// cell, two blanks apart. Cells are UTF-8; each character takes one place.
void print_table(const std::vector<std::vector<std::string>>& rows);

}  // namespace tether
