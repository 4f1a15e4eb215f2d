#pragma once

#include <filesystem>
#include <string>

namespace tether {

/// Writes `script` to `folder`/`name`, to be restyled and run again, and runs it there. Throws if
/// it cannot be written, gnuplot is missing (naming the package) or gnuplot fails.
void run_gnuplot(const std::filesystem::path& folder, const std::string& name,
                 const std::string& script);

}  // namespace tether
