#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <vector>

#include "tools/experiment/sweep/experiment.hpp"
#include "tools/experiment/sweep/identity.hpp"
#include "tools/experiment/sweep/run_store.hpp"

namespace tether {

/// One run of a sweep.
struct SweepTask {
  std::size_t arm;
  std::uint64_t seed;
};

/// Which runs a sweep, or a shard of it, still needs, and in which order: the first seed of all
/// arms, then the second, so that an early look sees all arms.
///
/// With precision an arm gets seeds batch by batch, and whether it needs another batch is decided
/// when all runs of the last one are there, from all its results in the order of seeds: the same
/// runs are made in whatever order they end. Runs that failed count as runs but not as results.
///
/// Shards: of a fixed number of runs, every count-th run; with precision, every count-th arm.
class SweepSchedule {
 public:
  /// The half-width of the mean's 95 % interval.
  using HalfWidth = std::function<double(const std::vector<double>& results)>;

  /// `experiment` must outlive it.
  SweepSchedule(const Experiment& experiment, const Shard& shard, HalfWidth half_width);

  /// A run that is there already, before the first next(); `result`: of the precision's metric,
  /// nullopt if the run failed. Throws UsageError if it is not one of this schedule's.
  void restore(const SweepTask& task, std::optional<double> result);

  /// A run to make now. Nullopt: none until one under way has ended, or none at all (is_done()).
  std::optional<SweepTask> next();
  /// A run has ended.
  void end(const SweepTask& task, std::optional<double> result);

  /// Nothing is to be run or under way; known from the first next() on.
  bool is_done() const { return started_ && open_arms_ == 0; }
  /// Runs that this schedule has as far as is known now: precision may ask for more.
  std::size_t known_runs() const { return known_runs_; }
  std::size_t ended_runs() const { return ended_runs_; }

 private:
  enum class State : std::uint8_t { open, given, ended };
  struct ArmState {
    bool is_open = false;         ///< needs runs, or may
    std::size_t wanted = 0;       ///< its first so many runs
    std::size_t missing = 0;      ///< number of them that have not ended
    std::vector<State> runs;      ///< by number
    std::vector<double> results;  ///< by number, NaN where there is none; with precision only
  };

  bool is_mine(std::size_t arm, std::size_t number) const;
  void want(std::size_t arm, std::size_t runs);
  void settle(std::size_t arm);
  void record(const SweepTask& task, std::optional<double> result);

  const Experiment& experiment_;
  Shard shard_;
  HalfWidth half_width_;
  std::vector<ArmState> arms_;
  bool started_ = false;
  std::size_t round_ = 0;  ///< no run of a lower number is to be handed out
  std::size_t arm_ = 0;    ///< nor one of this number of a lower arm
  std::size_t open_arms_ = 0;
  std::size_t known_runs_ = 0;
  std::size_t ended_runs_ = 0;
};

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
