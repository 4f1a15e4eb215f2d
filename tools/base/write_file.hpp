#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// Replaces what was in the file. Throws std::runtime_error unless all has reached it.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace tether
