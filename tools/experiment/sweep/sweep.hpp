#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <vector>

#include "tools/experiment/store/run_store.hpp"
#include "tools/experiment/sweep/schedule.hpp"

namespace tether {

/// How far a sweep is.
struct SweepProgress {
  std::size_t ended = 0;   ///< runs that are in the store, earlier sessions' included
  std::size_t known = 0;   ///< runs needed, as far as is known now
  std::size_t failed = 0;  ///< failed ones among the ended
  std::size_t made = 0;    ///< by this session
  double elapsed_s = 0.0;  ///< wall time of this session
};

struct SweepOptions {
  std::size_t jobs = 1;  ///< threads that run
  SweepSchedule::HalfWidth half_width;
  /// Called by the caller's thread, a few times a second and at the end.
  std::function<void(const SweepProgress&)> show;
  /// Function that makes a run; run_once().
  std::function<RunResult(const Scenario&, double trajectory_period_s, std::size_t arm)> run;
};

/// Missing parts of a sweep.
struct SweepEnd {
  bool is_complete = false;        ///< the store has all runs
  std::vector<StoredRun> missing;  ///< runs that were to be repeated after their second try, too
};

/// Makes all runs that the store lacks, with `jobs` threads, and puts each into the store as soon
/// as it ends (at most a quarter of a second later). A run that is to be repeated is made once
/// more, and is not stored if that, too, is to be repeated: the next sweep into the store tries it
/// again. If `stop` becomes true before the end, the runs under way are finished and stored.
/// Results do not depend on `jobs`. Throws what the store throws, after all threads have ended.
SweepEnd run_sweep(const Experiment& experiment, const Shard& shard, RunStore& store,
                   const SweepOptions& options, const std::atomic<bool>& stop);

}  // namespace tether
