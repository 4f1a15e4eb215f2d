#include "tools/experiment/sweep/session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <csignal>
#include <string>
#include <thread>
#include <vector>

#include "common/base/errors.hpp"
#include "tools/experiment/statistics/statistics.hpp"
#include "tools/experiment/sweep/export.hpp"
#include "tools/experiment/sweep/lock.hpp"
#include "tools/experiment/sweep/progress.hpp"
#include "tools/experiment/sweep/run_once.hpp"
#include "tools/experiment/sweep/sweep.hpp"

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
  const SweepEnd end = run_sweep(experiment, shard, store, how, stop);
  bar.end();
  const auto name = [&](std::size_t arm, std::uint64_t seed, const std::string& why) {
    return fmt::format("{}, seed {}: {}", experiment.arms.at(arm).text(), seed, why);
  };
  for (const StoredRun& run : end.missing) {
    fmt::print(stderr, "no result: {}\n", name(run.arm, run.seed, run.result.failure));
  }
  try {
    store.flush();
  } catch (const std::runtime_error&) {
    // A reader has it open: it is complete, in three files.
  }
  SweepOutcome outcome{database,        store.size(),        store.failures(), "",
                       end.is_complete, store.wall_time_s(), store.plant()};
  if (const auto failed = store.first_failure()) {
    outcome.first_failure = name(failed->arm, failed->seed, failed->why);
  }
  return outcome;
}

}  // namespace tether
