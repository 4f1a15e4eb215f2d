#include "tools/experiment/sweep/schedule.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/base/errors.hpp"

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

}  // namespace tether
