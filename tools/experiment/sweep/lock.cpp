#include "tools/experiment/sweep/lock.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/errors.hpp"

namespace tether {

SweepLock::SweepLock(const std::filesystem::path& database) : file_(database.string() + ".lock") {
  fd_ = check_system_call("making " + file_,
                          open(file_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0666));
  const bool is_locked = flock(fd_, LOCK_EX | LOCK_NB) == 0;
  const int error = errno;
  if (is_locked && is_still_there()) return;
  close(fd_);
  if (!is_locked && error != EWOULDBLOCK) {
    throw std::system_error(error, std::generic_category(), "locking " + file_);
  }
  throw UsageError(fmt::format("another process is writing {}", database.string()));
}

SweepLock::~SweepLock() {
  unlink(file_.c_str());
  close(fd_);
}

bool SweepLock::is_still_there() const {
  struct stat ours {
  }, now{};
  return fstat(fd_, &ours) == 0 && stat(file_.c_str(), &now) == 0 && ours.st_ino == now.st_ino;
}

}  // namespace tether
