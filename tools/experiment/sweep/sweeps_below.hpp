#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace tether {

/// The databases of a report's folder: its own runs.sqlite, else those of its subfolders, by name.
/// Throws UsageError if there is none.
std::vector<std::filesystem::path> databases_below(const std::filesystem::path& folder);

/// Where `tether view FOLDER` has the runs of one of them: "runs/ARM/SEED" of the folder's own,
/// "runs/SUBFOLDER/ARM/SEED" else, and this is what comes before "/ARM/SEED". Characters other than
/// letters, digits, '-', '.' and '_' are as %XX.
std::string address_of_runs(const std::filesystem::path& folder,
                            const std::filesystem::path& database);

}  // namespace tether
