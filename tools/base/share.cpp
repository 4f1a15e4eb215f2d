#include "tools/base/share.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "tools/base/process.hpp"

namespace tether {

std::filesystem::path shared_file(const std::string& name) {
  auto file = (executable_folder() / "../share/tether" / name).lexically_normal();
  if (std::filesystem::exists(file)) return file;
  throw std::runtime_error(
      fmt::format("{} is missing: it belongs beside the program's folder", file.string()));
}

}  // namespace tether
