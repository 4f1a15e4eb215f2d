#include "tools/base/replacing_output.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <fstream>
#include <stdexcept>
#include <system_error>
#include <utility>

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

namespace fs = std::filesystem;

ReplacingOutput::ReplacingOutput(fs::path file) : file_(std::move(file)) {
  std::error_code error;
  const fs::file_status status = fs::symlink_status(file_, error);
  replace_ = !fs::exists(status) || fs::is_regular_file(status);
  written_ = replace_ ? fs::path(file_.string() + std::string(kUnfinished)) : file_;
  constexpr mode_t kReadableByAll = 0666;  // less the user's mask
  fd_ = open(written_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, kReadableByAll);
  if (fd_ < 0) fail(errno);
}

ReplacingOutput::~ReplacingOutput() {
  if (fd_ < 0) return;
  ::close(fd_);
  std::error_code ignored;
  if (replace_) fs::remove(written_, ignored);
}

void ReplacingOutput::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) fail(errno);
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
}

void ReplacingOutput::close() {
  if (::close(std::exchange(fd_, -1)) != 0) fail(errno);
  std::error_code error;
  if (replace_) fs::rename(written_, file_, error);
  if (error) fail(error.value());
}

void ReplacingOutput::fail(int error) const {
  throw std::runtime_error(fmt::format("cannot write \"{}\": {}", file_.string(),
                                       std::generic_category().message(error)));
}

}  // namespace tether
