#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace tether {

/// Suffix that write_file() adds to the name of a file that is not complete yet.
inline constexpr std::string_view kUnfinished = ".unfinished";

/// Replaces what was in the file once all is written: it stays as it was otherwise. Throws
/// std::runtime_error with the system's reason unless all has reached it.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace tether
