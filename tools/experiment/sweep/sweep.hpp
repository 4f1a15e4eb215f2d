#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "tools/experiment/store/run_store.hpp"
#include "tools/experiment/sweep/schedule.hpp"

namespace tether {

/// How far a sweep is.
struct SweepProgress {
  std::size_t ended = 0;   ///< runs that are in the store, earlier sessions' included
  std::size_t known = 0;   ///< runs needed, as far as is known now
  std::size_t failed = 0;  ///< of the ended ones
  std::size_t made = 0;    ///< by this session
  double elapsed_s = 0.0;  ///< wall time of this session
};

struct SweepOptions {
  std::size_t jobs = 1;  ///< threads that run
  SweepSchedule::HalfWidth half_width;
  /// Called by the caller's thread, a few times a second and at the end.
  std::function<void(const SweepProgress&)> show;
  /// What a run is; run_once().
  std::function<RunResult(const Scenario&, double trajectory_period_s, std::size_t arm)> run;
};

/// Makes all runs that the store lacks, with `jobs` threads, and puts each into the store as soon
/// as it ends (at most a quarter of a second later). True if the store is complete; false if `stop`
/// became true before: then the runs under way have been finished and stored. Results do not depend
/// on `jobs`. Throws what the store throws, after all threads have ended.
bool run_sweep(const Experiment& experiment, const Shard& shard, RunStore& store,
               const SweepOptions& options, const std::atomic<bool>& stop);

}  // namespace tether
