#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "tools/view/server/page_folder.hpp"

namespace tether {

/// A file of the page by its path, such as "model/topics.js"; none if there is no such file.
using ReadPageFile = std::function<std::optional<std::string>(const std::string& path)>;

/// Reads the files of a folder, which must outlive this.
ReadPageFile files_of(const PageFolder& folder);

/// The page as one HTML file that needs no server, with a recording (recording.hpp, packed by gzip
/// and base64) for it to show. Files that index.html names become data: URLs. Modules cannot import
/// each other by relative address from there: each gets a bare name, "tether/model/topics.js",
/// which an import map leads to its data: URL. Its Content-Security-Policy allows no request at
/// all. Throws UsageError if a file is missing.
std::string one_file_page(const ReadPageFile& read, std::string_view recording_base64);

/// A module of the page, at `path`, whose imports are by bare names; `imported` receives their
/// paths.
std::string with_bare_imports(const std::string& module, const std::string& path,
                              const std::function<void(const std::string&)>& imported);

}  // namespace tether
