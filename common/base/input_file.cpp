#include "common/base/input_file.hpp"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <system_error>
#include <vector>

#include "common/base/errors.hpp"
#include "common/base/nearest_name.hpp"
#include "common/base/share.hpp"

namespace tether {
namespace {

[[noreturn]] void refuse(const std::string& file, const std::string& what,
                         const std::string& reason) {
  throw UsageError(fmt::format("cannot read {} \"{}\": {}", what, file, reason));
}

/// The file with the most similar name there, or in the same folder of the installed files, as a
/// question; "" if nothing does.
std::string similar_name(const std::string& file) {
  namespace fs = std::filesystem;
  const fs::path path(file);
  std::vector<std::string> names;
  for (const fs::path& folder : {path.parent_path() / ".", shared_path(path.parent_path())}) {
    std::error_code error;
    for (auto it = fs::directory_iterator(folder, error); !error && it != fs::end(it);
         it.increment(error)) {
      names.push_back(it->path().filename().string());
    }
  }
  if (names.empty()) return "";
  std::sort(names.begin(), names.end());
  const std::string name = path.filename().string();
  const std::string& nearest = nearest_name(names, name);
  if (edit_distance(nearest, name) > std::min<std::size_t>(2, name.size() / 3)) return "";
  return fmt::format(" (did you mean \"{}\"?)", (path.parent_path() / nearest).string());
}

std::string system_reason() { return std::generic_category().message(errno); }

}  // namespace

void check_input(const std::string& file, const std::string& what, std::uintmax_t most_bytes) {
  struct stat status {};
  if (stat(file.c_str(), &status) != 0) {
    const std::string reason = system_reason();
    refuse(file, what, reason + similar_name(file));
  }
  if (S_ISDIR(status.st_mode)) refuse(file, what, "it is a directory");
  if (!S_ISREG(status.st_mode)) refuse(file, what, "it is not a regular file");
  if (static_cast<std::uintmax_t>(status.st_size) > most_bytes) {
    refuse(file, what,
           fmt::format("it has {} bytes, more than the {} allowed", status.st_size, most_bytes));
  }
}

std::ifstream open_input(const std::string& file, const std::string& what,
                         std::uintmax_t most_bytes) {
  check_input(file, what, most_bytes);
  std::ifstream in(file, std::ios::binary);
  if (!in) refuse(file, what, system_reason());
  return in;
}

std::string read_input(const std::string& file, const std::string& what,
                       std::uintmax_t most_bytes) {
  std::ifstream in = open_input(file, what, most_bytes);
  std::string text;
  char chunk[1 << 14];
  // Files of the kernel have no size: what comes counts.
  while (in.read(chunk, sizeof chunk) || in.gcount() > 0) {
    text.append(chunk, static_cast<std::size_t>(in.gcount()));
    if (text.size() > most_bytes) refuse(file, what, fmt::format("more than {} bytes", most_bytes));
  }
  if (in.bad()) refuse(file, what, system_reason());
  return text;
}

}  // namespace tether
