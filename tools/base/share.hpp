#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// A file that programs need beside themselves (pages, scripts), from ../share/tether of the
/// executable's folder. Throws std::runtime_error that names it if it is not there.
std::filesystem::path shared_file(const std::string& name);

}  // namespace tether
