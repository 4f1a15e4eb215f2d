#include "tools/experiment/sweep/sweep.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/run_settings.hpp"

namespace tether {

SweepSchedule::SweepSchedule(const Experiment& experiment, const Shard& shard, HalfWidth half_width)
    : experiment_(experiment),
      shard_(shard),
      half_width_(std::move(half_width)),
      arms_(experiment.arms.size()) {
  const auto& precision = experiment.precision;
  const std::size_t first = precision ? precision->batch : experiment.seeds.size();
  for (std::size_t arm = 0; arm < arms_.size(); ++arm) {
    want(arm, first);
    arms_[arm].is_open = arms_[arm].missing > 0;
    if (arms_[arm].is_open) ++open_arms_;
  }
}

bool SweepSchedule::is_mine(std::size_t arm, std::size_t number) const {
  const std::size_t run = arm * experiment_.seeds.size() + number;
  return (experiment_.precision ? arm : run) % shard_.count == shard_.index - 1;
}

void SweepSchedule::want(std::size_t arm, std::size_t runs) {
  ArmState& a = arms_[arm];
  if (a.runs.size() < runs) a.runs.resize(runs, State::open);
  for (std::size_t number = a.wanted; number < runs; ++number) {
    if (!is_mine(arm, number)) continue;
    ++known_runs_;
    if (a.runs[number] != State::ended) ++a.missing;
  }
  round_ = std::min(round_, a.wanted);
  arm_ = 0;
  a.wanted = runs;
}

void SweepSchedule::restore(const SweepTask& task, std::optional<double> result) {
  const auto number = task.arm < arms_.size() ? experiment_.number(task.arm, task.seed)
                                              : std::optional<std::size_t>{};
  if (!number || !is_mine(task.arm, *number)) {
    throw UsageError(fmt::format("combination {} with seed {} does not belong to this sweep",
                                 task.arm, task.seed));
  }
  record(task, result);
}

void SweepSchedule::record(const SweepTask& task, std::optional<double> result) {
  ArmState& arm = arms_[task.arm];
  const std::size_t number = experiment_.number(task.arm, task.seed).value();
  if (arm.runs.size() <= number) arm.runs.resize(number + 1, State::open);
  arm.runs[number] = State::ended;
  ++ended_runs_;
  if (number < arm.wanted) --arm.missing;
  if (!experiment_.precision) return;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  if (arm.results.size() <= number) arm.results.resize(number + 1, kNone);
  arm.results[number] = result.value_or(kNone);
}

std::optional<SweepTask> SweepSchedule::next() {
  if (!std::exchange(started_, true)) {
    for (std::size_t arm = 0; arm < arms_.size(); ++arm) settle(arm);
  }
  for (; round_ < experiment_.seeds.size(); ++round_, arm_ = 0) {
    for (; arm_ < arms_.size(); ++arm_) {
      ArmState& arm = arms_[arm_];
      if (round_ >= arm.wanted || arm.runs[round_] != State::open || !is_mine(arm_, round_)) {
        continue;
      }
      arm.runs[round_] = State::given;
      return SweepTask{arm_, experiment_.seed(arm_, round_)};
    }
  }
  return std::nullopt;
}

void SweepSchedule::end(const SweepTask& task, std::optional<double> result) {
  record(task, result);
  settle(task.arm);
}

/// Closes the arm, or wants more of it, if all wanted runs have ended.
void SweepSchedule::settle(std::size_t arm) {
  ArmState& a = arms_[arm];
  while (a.is_open && a.missing == 0) {
    const auto& precision = experiment_.precision;
    std::vector<double> results;
    for (std::size_t i = 0; precision && i < a.wanted; ++i) {
      if (std::isfinite(a.results[i])) results.push_back(a.results[i]);
    }
    const bool is_enough = !precision || a.wanted >= precision->most_seeds ||
                           (results.size() >= 2 && half_width_(results) <= precision->half_width);
    if (is_enough) {
      a.is_open = false;
      --open_arms_;
      return;
    }
    want(arm, std::min(a.wanted + precision->batch, precision->most_seeds));
  }
}

namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kStorePeriod{250};

/// Threads that take tasks and give back results.
class Workers {
 public:
  Workers(const Experiment& experiment, const SweepOptions& options)
      : experiment_(experiment), options_(options) {
    try {
      while (threads_.size() < options.jobs) threads_.emplace_back([this] { work(); });
    } catch (const std::system_error& error) {
      end();
      throw std::runtime_error(
          fmt::format("cannot start thread {} of {}: {}; ask for fewer with --jobs, or raise the "
                      "limits of processes or memory (ulimit -u, -v)",
                      threads_.size() + 1, options.jobs, error.code().message()));
    }
  }
  ~Workers() { end(); }
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  void give(const SweepTask& task) {
    {
      const std::lock_guard lock(mutex_);
      tasks_.push_back(task);
    }
    more_tasks_.notify_one();
  }
  /// Tasks that no worker has begun.
  std::size_t waiting() {
    const std::lock_guard lock(mutex_);
    return tasks_.size();
  }
  std::size_t forget_waiting() {
    const std::lock_guard lock(mutex_);
    return std::exchange(tasks_, {}).size();
  }
  /// Runs that have ended; waits for something, but not beyond `until`.
  std::vector<StoredRun> take(Clock::time_point until) {
    std::unique_lock lock(mutex_);
    more_results_.wait_until(lock, until, [this] { return !results_.empty(); });
    return std::exchange(results_, {});
  }

 private:
  void end() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
      tasks_.clear();
    }
    more_tasks_.notify_all();
    for (std::thread& thread : threads_) thread.join();
  }

  void work() {
    std::unique_lock lock(mutex_);
    for (;;) {
      more_tasks_.wait(lock, [this] { return ending_ || !tasks_.empty(); });
      if (ending_) return;
      const SweepTask task = tasks_.front();
      tasks_.pop_front();
      lock.unlock();
      StoredRun run{task.arm, task.seed, make(task)};
      lock.lock();
      results_.push_back(std::move(run));
      more_results_.notify_one();
    }
  }

  RunResult make(const SweepTask& task) const {
    Scenario scenario = experiment_.arms[task.arm].scenario;
    scenario.get<RunSettings>().seed = task.seed;
    return options_.run(scenario, experiment_.trajectory_period_s, task.arm);
  }

  const Experiment& experiment_;
  const SweepOptions& options_;
  std::mutex mutex_;
  std::condition_variable more_tasks_;
  std::condition_variable more_results_;
  std::deque<SweepTask> tasks_;
  std::vector<StoredRun> results_;
  bool ending_ = false;
  std::vector<std::thread> threads_;  // last: they use the others
};

/// The thread that called: gives tasks, stores results, shows progress.
class Session {
 public:
  Session(const Experiment& experiment, const Shard& shard, RunStore& store,
          const SweepOptions& options)
      : options_(options),
        store_(store),
        schedule_(experiment, shard, options.half_width),
        metric_(experiment.precision ? metric_number(experiment.precision->metric) : std::nullopt),
        workers_(experiment, options) {
    store.for_each([this](const StoredRun& run) {
      schedule_.restore({run.arm, run.seed}, result_of(run));
      if (!run.result.failure.empty()) ++progress_.failed;
    });
  }

  SweepEnd run(const std::atomic<bool>& stop) {
    fill();
    Clock::time_point next_store = start_ + kStorePeriod;
    while (under_way_ > 0) {
      if (stop) under_way_ -= workers_.forget_waiting();
      for (StoredRun& run : workers_.take(next_store)) {
        if (run.result.is_to_be_repeated && !stop && repeated_.emplace(run.arm, run.seed).second) {
          workers_.give({run.arm, run.seed});
          continue;
        }
        --under_way_;
        if (run.result.is_to_be_repeated) {
          missing_.push_back(std::move(run));
          continue;
        }
        schedule_.end({run.arm, run.seed}, result_of(run));
        if (!run.result.failure.empty()) ++progress_.failed;
        ++progress_.made;
        ended_.push_back(std::move(run));
      }
      if (!stop) fill();
      if (Clock::now() < next_store && under_way_ > 0) continue;
      store();
      next_store = Clock::now() + kStorePeriod;
    }
    show();
    return {schedule_.is_done(), std::move(missing_)};
  }

 private:
  std::optional<double> result_of(const StoredRun& run) const {
    if (!metric_ || !run.result.failure.empty()) return std::nullopt;
    return run.result.metrics[*metric_];
  }
  /// A few tasks ahead, so that no worker waits for this thread.
  void fill() {
    for (std::size_t waiting = workers_.waiting(); waiting < 2 * options_.jobs; ++waiting) {
      const auto task = schedule_.next();
      if (!task) return;
      ++under_way_;
      workers_.give(*task);
    }
  }
  void store() {
    if (!ended_.empty()) store_.add(ended_);
    ended_.clear();
    const Clock::time_point now = Clock::now();
    store_.add_wall_time(std::chrono::duration<double>(now - std::exchange(stored_, now)).count());
    show();
  }
  void show() {
    progress_.ended = schedule_.ended_runs();
    progress_.known = schedule_.known_runs();
    progress_.elapsed_s = std::chrono::duration<double>(Clock::now() - start_).count();
    if (options_.show) options_.show(progress_);
  }

  const SweepOptions& options_;
  RunStore& store_;
  SweepSchedule schedule_;
  std::optional<std::size_t> metric_;
  Clock::time_point start_ = Clock::now();
  Clock::time_point stored_ = start_;
  SweepProgress progress_;
  std::size_t under_way_ = 0;
  std::vector<StoredRun> ended_;                              // not in the store yet
  std::set<std::pair<std::size_t, std::uint64_t>> repeated_;  // by arm and seed
  std::vector<StoredRun> missing_;
  Workers workers_;
};

}  // namespace

SweepEnd run_sweep(const Experiment& experiment, const Shard& shard, RunStore& store,
                   const SweepOptions& options, const std::atomic<bool>& stop) {
  SweepEnd end = Session(experiment, shard, store, options).run(stop);
  if (end.is_complete) store.set_complete();
  return end;
}

}  // namespace tether
