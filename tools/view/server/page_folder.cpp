#include "tools/view/server/page_folder.hpp"

#include <fmt/format.h>

#include <array>
#include <exception>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"

namespace tether {

std::string media_type(const std::filesystem::path& name) {
  static constexpr std::array<std::pair<const char*, const char*>, 13> kTypes{{
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".json", "application/json"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".ico", "image/x-icon"},
      {".woff2", "font/woff2"},
      {".woff", "font/woff"},
      {".ttf", "font/ttf"},
      {".txt", "text/plain; charset=utf-8"},
      {".webmanifest", "application/manifest+json"},
  }};
  for (const auto& [ending, type] : kTypes) {
    if (name.extension() == ending) return type;
  }
  return "";
}

PageFolder::PageFolder(const std::filesystem::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  std::filesystem::recursive_directory_iterator it(folder, error), end;
  for (; !error && it != end; it.increment(error)) {
    const std::filesystem::path& path = it->path();
    const bool hidden = path.filename().string().starts_with('.');
    if (hidden) it.disable_recursion_pending();
    if (hidden || it->is_symlink(error) || !it->is_regular_file(error)) continue;
    if (media_type(path).empty() || files_.size() == kMostFiles) continue;
    files_.emplace("/" + path.lexically_relative(folder).generic_string(), path);
  }
  if (!files_.contains("/index.html")) {
    throw UsageError(fmt::format(
        "{} has no index.html: it should hold the page that tether view shows", folder.string()));
  }
}

std::optional<PageFolder::File> PageFolder::find(std::string_view path) const {
  const auto found = files_.find(path == "/" ? "/index.html" : path);
  if (found == files_.end()) return std::nullopt;
  try {
    return File{media_type(found->second),
                read_input(found->second.string(), "the page's file", kMostFileBytes)};
  } catch (const std::exception&) {
    return std::nullopt;  // it is gone
  }
}

}  // namespace tether
