#include "common/base/share.hpp"

#include <fmt/format.h>
#include <sys/auxv.h>

#include <stdexcept>

namespace tether {

namespace fs = std::filesystem;

fs::path executable_folder() {
  std::error_code error;
  fs::path executable = fs::read_symlink("/proc/self/exe", error);
  if (error) {  // no /proc: as it was started
    // NOLINTNEXTLINE(performance-no-int-to-ptr): so it comes from the kernel
    executable = fs::absolute(reinterpret_cast<const char*>(getauxval(AT_EXECFN)));
  }
  return executable.parent_path();
}

fs::path shared_path(const fs::path& name) {
  return (executable_folder() / "../share/tether" / name).lexically_normal();
}

fs::path shared_file(const std::string& name) {
  auto file = shared_path(name);
  if (fs::exists(file)) return file;
  throw std::runtime_error(
      fmt::format("{} is missing: it belongs beside the program's folder", file.string()));
}

std::string input_named(const std::string& file) {
  std::error_code error;
  if (file.empty() || fs::path(file).is_absolute() || fs::exists(file, error)) return file;
  const fs::path brought = shared_path(file);
  return fs::is_regular_file(brought, error) ? brought.string() : file;
}

}  // namespace tether
