#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

namespace tether {

/// The files that make up the page. Which there are is looked up once, at the start: a request
/// names one of them or nothing, so that no address leads out of the folder.
class PageFolder {
 public:
  struct File {
    std::string type;  ///< "text/html; charset=utf-8"
    std::string bytes;
  };
  static constexpr std::size_t kMostFiles = 10'000;
  static constexpr std::uintmax_t kMostFileBytes = std::uintmax_t{16} << 20;

  /// Takes regular files of known kinds; neither links nor what begins with a dot. Throws
  /// UsageError if there is no index.html. An empty path: no files.
  explicit PageFolder(const std::filesystem::path& folder);

  /// The file as it is now, "/" is index.html; none if there is no such file.
  std::optional<File> find(std::string_view path) const;

 private:
  std::map<std::string, std::filesystem::path, std::less<>> files_;  ///< by "/name"
};

/// Media type by a file's name; empty if it is of no kind that a page consists of.
std::string media_type(const std::filesystem::path& name);

}  // namespace tether
