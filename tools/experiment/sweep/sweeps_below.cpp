#include "tools/experiment/sweep/sweeps_below.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>

#include "common/base/errors.hpp"
#include "tools/experiment/sweep/export.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kAsTheyAre =
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._";

}  // namespace

std::vector<fs::path> databases_below(const fs::path& folder) {
  std::vector<fs::path> files;
  if (fs::exists(database_of(folder))) return {database_of(folder)};
  if (fs::is_directory(folder)) {
    for (const auto& entry : fs::directory_iterator(folder)) {
      if (entry.is_directory() && fs::exists(database_of(entry.path()))) {
        files.push_back(database_of(entry.path()));
      }
    }
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) {
    throw UsageError(
        fmt::format("no sweep in {}: there is no runs.sqlite in it or below", folder.string()));
  }
  return files;
}

std::string address_of_runs(const fs::path& folder, const fs::path& database) {
  std::string address = "runs";
  if (database == database_of(folder)) return address;
  address += '/';
  for (const char c : database.parent_path().filename().string()) {
    address += kAsTheyAre.find(c) != std::string_view::npos
                   ? std::string(1, c)
                   : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return address;
}

}  // namespace tether
