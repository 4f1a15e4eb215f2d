#include "common/base/say.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace tether {
namespace {

/// Checks as systemd.exec(5) says: stderr may have been redirected since.
bool stderr_is_the_journal() {
  const char* const stream = std::getenv("JOURNAL_STREAM");
  struct stat now {};
  return stream != nullptr && fstat(STDERR_FILENO, &now) == 0 &&
         stream == fmt::format("{}:{}", now.st_dev, now.st_ino);
}

}  // namespace

void say(Severity severity, std::string_view line) {
  static const bool is_journal = stderr_is_the_journal();
  const std::string text = is_journal ? fmt::format("<{}>{}\n", static_cast<int>(severity), line)
                                      : fmt::format("{}\n", line);
  // A line that cannot be written is lost. It must not end a bridge, as fmt::print's exception
  // would.
  (void)std::fwrite(text.data(), 1, text.size(), stderr);
}

}  // namespace tether
