#include "tools/sweep_session.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "common/errors.hpp"
#include "common/system_error.hpp"
#include "tools/experiment/statistics.hpp"
#include "tools/experiment/sweep.hpp"
#include "tools/experiment/sweep_export.hpp"
#include "tools/experiment/sweep_progress.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

std::atomic<bool> stop{false};

/// Ctrl-C and SIGTERM end the sweep after the runs under way; a file that may not grow further is
/// an error like a full disk, not a death.
void stop_on_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // a second one ends it at once
  for (const int signal : {SIGINT, SIGTERM}) sigaction(signal, &action, nullptr);
  std::signal(SIGXFSZ, SIG_IGN);
}

/// Keeps another process from sweeping into the same database at the same time.
class SweepLock {
 public:
  explicit SweepLock(const fs::path& database) : file_(database.string() + ".lock") {
    fd_ = check_system_call("making " + file_,
                            open(file_.c_str(), O_CREAT | O_RDWR | O_CLOEXEC | O_NOFOLLOW, 0666));
    const bool is_locked = flock(fd_, LOCK_EX | LOCK_NB) == 0;
    const int error = errno;
    if (is_locked && is_still_there()) return;
    close(fd_);
    if (!is_locked && error != EWOULDBLOCK) {
      throw std::system_error(error, std::generic_category(), "locking " + file_);
    }
    throw UsageError(fmt::format("another process is sweeping into {}", database.string()));
  }
  ~SweepLock() {
    unlink(file_.c_str());
    close(fd_);
  }
  SweepLock(const SweepLock&) = delete;
  SweepLock& operator=(const SweepLock&) = delete;

 private:
  /// Not removed by its last owner between our opening and locking it.
  bool is_still_there() const {
    struct stat ours {
    }, now{};
    return fstat(fd_, &ours) == 0 && stat(file_.c_str(), &now) == 0 && ours.st_ino == now.st_ino;
  }

  std::string file_;
  int fd_ = -1;
};

void make_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (fs::is_directory(folder)) return;
  throw UsageError(fmt::format("cannot make the folder {}: {}", folder.string(),
                               error ? error.message() : "it is a file"));
}

double mean_half_width(const std::vector<double>& results) {
  return half_width(mean_interval(results, kConfidence, kBootstrapSeed));
}

}  // namespace

std::size_t default_jobs() { return std::max<std::size_t>(1, std::thread::hardware_concurrency()); }

SweepOutcome sweep_into(const fs::path& folder, const Experiment& experiment, const Shard& shard,
                        std::size_t jobs) {
  make_folder(folder);
  const fs::path database = database_in(folder, shard);
  const SweepLock lock(database);
  RunStore store = RunStore::begin(database, experiment, shard);
  if (const std::size_t before = store.size(); before > 0) {
    fmt::print(stderr, "{} has {} runs already\n", database.string(), before);
  }
  stop_on_signals();
  ProgressBar bar;
  const SweepOptions how{jobs, mean_half_width, [&bar](const SweepProgress& p) { bar.show(p); },
                         run_once};
  const bool is_complete = run_sweep(experiment, shard, store, how, stop);
  bar.end();
  return {database,    store.size(),        store.failures(),
          is_complete, store.wall_time_s(), store.plant()};
}

}  // namespace tether
