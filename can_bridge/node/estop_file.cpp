#include "can_bridge/node/estop_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/say.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

bool sync(const fs::path& path, int flags) {
  const int fd = ::open(path.c_str(), flags | O_CLOEXEC, 0644);
  if (fd < 0) return false;
  const bool done = ::fsync(fd) == 0;
  return ::close(fd) == 0 && done;
}

}  // namespace

EstopFile::EstopFile(fs::path path) : path_(std::move(path)), latched_(fs::exists(path_)) {
  std::error_code error;
  if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), error);
  if (!write() || (!latched_ && !fs::remove(path_, error))) {
    throw UsageError(fmt::format(
        "cannot write \"{}\", which has to remember a latched e-stop: {}: see can.estop_file",
        path_.string(), std::strerror(errno)));
  }
}

bool EstopFile::write() const {
  return sync(path_, O_WRONLY | O_CREAT) &&
         sync(path_.has_parent_path() ? path_.parent_path() : ".", O_RDONLY | O_DIRECTORY);
}

void EstopFile::remember(bool latched) {
  if (latched == latched_) return;
  std::error_code error;
  const bool done = latched ? write() : fs::remove(path_, error) || !error;
  if (done) {
    latched_ = latched;
  } else if (!std::exchange(failed_, true)) {
    say(Severity::error, fmt::format("tether-can-bridge: \"{}\" does not remember the e-stop: {}",
                                     path_.string(), std::strerror(errno)));
  }
}

fs::path default_estop_file(const std::string& vehicle, const std::string& interface) {
  const auto of = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value == nullptr ? "" : value);
  };
  fs::path folder = "/var/lib/tether";
  if (const std::string state = of("STATE_DIRECTORY"); !state.empty()) {
    folder = state.substr(0, state.find(':'));
  } else if (const std::string xdg = of("XDG_STATE_HOME"); !xdg.empty()) {
    folder = fs::path(xdg) / "tether";
  } else if (const std::string home = of("HOME"); !home.empty()) {
    folder = fs::path(home) / ".local/state/tether";
  }
  return folder / fmt::format("estop.{}.{}", vehicle, interface);
}

}  // namespace tether
