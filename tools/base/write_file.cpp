#include "tools/base/write_file.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace tether {

namespace fs = std::filesystem;

void write_file(const fs::path& file, const std::string& text) {
  std::error_code error;
  // A link is followed, and a device is not replaced.
  const fs::file_status status = fs::symlink_status(file, error);
  const bool replace = !fs::exists(status) || fs::is_regular_file(status);
  const fs::path written = replace ? fs::path(file.string() + std::string(kUnfinished)) : file;
  errno = 0;
  std::ofstream out(written, std::ios::binary);
  out << text;
  out.close();
  error.assign(out ? 0 : errno == 0 ? EIO : errno, std::generic_category());
  if (!error && replace) fs::rename(written, file, error);
  if (!error) return;
  std::error_code ignored;
  if (replace) fs::remove(written, ignored);
  throw std::runtime_error(fmt::format("cannot write \"{}\": {}", file.string(), error.message()));
}

}  // namespace tether
