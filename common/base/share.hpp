#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// The folder of the running executable: programs of the project lie side by side.
std::filesystem::path executable_folder();

/// Where what the project brings along (pages, scripts, scenarios) is if it is there: NAME in
/// ../share/tether of the executable's folder, in a build tree and where it is installed. An
/// absolute name is left as it is.
std::filesystem::path shared_path(const std::filesystem::path& name);

/// Path of a shared file. Throws std::runtime_error that names the file if it is not there.
std::filesystem::path shared_file(const std::string& name);

/// The input file that a user means by `file`: the file of this name; where there is none and the
/// name is relative, the one that the project brings along, so that
/// `tether run scenarios/paper.toml` works in any folder. `file` itself if there is neither.
std::string input_named(const std::string& file);

}  // namespace tether
