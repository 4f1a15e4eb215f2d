#include "tools/cli/log_out.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <system_error>

#include "common/base/errors.hpp"

namespace tether {

std::string log_out_beside(const std::string& file, const std::string& extension) {
  std::filesystem::path out(file);
  if (out.extension() == ".lcmlog" || out.extension() == ".log") out.replace_extension();
  return out.string() + extension;
}

void check_not_the_log(const std::string& file, const std::string& out) {
  std::error_code ignored;
  if (std::filesystem::equivalent(file, out, ignored)) {
    throw UsageError(fmt::format("--out {} is the log itself", out));
  }
}

void check_log_out(const std::string& file, const std::string& out) {
  check_not_the_log(file, out);
  std::error_code ignored;
  if (std::filesystem::is_directory(out, ignored)) {
    throw UsageError(fmt::format("--out {} is a directory", out));
  }
}

}  // namespace tether
