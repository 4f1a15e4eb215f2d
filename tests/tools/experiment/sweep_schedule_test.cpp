#include <gmock/gmock.h>

#include <deque>
#include <numeric>
#include <set>

#include "common/base/errors.hpp"
#include "tools/experiment/sweep/sweep.hpp"

namespace tether {
namespace {

using testing::ElementsAre;
using testing::SizeIs;
using Pair = std::pair<std::size_t, std::uint64_t>;

Experiment experiment(std::size_t arms, std::size_t seeds) {
  Experiment e;
  e.arms.resize(arms);
  e.seeds.resize(seeds);
  std::iota(e.seeds.begin(), e.seeds.end(), 1U);
  return e;
}

Experiment precise(std::size_t arms, double half_width, std::size_t most) {
  Experiment e = experiment(arms, most);
  e.precision = Precision{"epsilon_m", half_width, most, 10};
  return e;
}

/// Half the range: easy to foresee.
double half_range(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return 0.5 * (*high - *low);
}

/// Makes all runs, with up to `jobs` under way, the newest of which ends first.
template <class Result>
std::vector<Pair> run_all(SweepSchedule& schedule, std::size_t jobs, Result result) {
  std::vector<Pair> made;
  std::deque<SweepTask> under_way;
  for (;;) {
    while (under_way.size() < jobs) {
      const auto task = schedule.next();
      if (!task) break;
      under_way.push_back(*task);
      made.emplace_back(task->arm, task->seed);
    }
    if (under_way.empty()) break;
    const SweepTask ended = under_way.back();
    under_way.pop_back();
    schedule.end(ended, result(ended));
  }
  EXPECT_TRUE(schedule.is_done());
  return made;
}

std::optional<double> one(const SweepTask&) { return 1.0; }

TEST(SweepSchedule, TakesTheFirstSeedOfAllArmsThenTheSecond) {
  const Experiment e = experiment(2, 2);
  SweepSchedule schedule(e, {}, half_range);
  EXPECT_THAT(run_all(schedule, 1, one),
              ElementsAre(Pair{0, 1}, Pair{1, 1}, Pair{0, 2}, Pair{1, 2}));
  EXPECT_EQ(schedule.ended_runs(), 4U);
  EXPECT_EQ(schedule.known_runs(), 4U);
}

TEST(SweepSchedule, LeavesOutWhatIsThereAlready) {
  const Experiment e = experiment(2, 2);
  SweepSchedule schedule(e, {}, half_range);
  schedule.restore({1, 1}, std::nullopt);
  schedule.restore({0, 2}, std::nullopt);
  EXPECT_THAT(run_all(schedule, 1, one), ElementsAre(Pair{0, 1}, Pair{1, 2}));
}

TEST(SweepSchedule, IsDoneAtOnceIfAllIsThere) {
  const Experiment e = experiment(1, 1);
  SweepSchedule schedule(e, {}, half_range);
  schedule.restore({0, 1}, std::nullopt);
  EXPECT_EQ(schedule.next(), std::nullopt);
  EXPECT_TRUE(schedule.is_done());
}

TEST(SweepSchedule, IsNotDoneWhileARunIsUnderWay) {
  const Experiment e = experiment(1, 1);
  SweepSchedule schedule(e, {}, half_range);
  const auto task = schedule.next();
  EXPECT_EQ(schedule.next(), std::nullopt);
  EXPECT_FALSE(schedule.is_done());
  schedule.end(*task, 1.0);
  EXPECT_TRUE(schedule.is_done());
}

TEST(SweepSchedule, RefusesRunsOfAnotherSweep) {
  const Experiment e = experiment(2, 2);
  SweepSchedule schedule(e, {}, half_range);
  EXPECT_THROW(schedule.restore({0, 3}, std::nullopt), UsageError);
  EXPECT_THROW(schedule.restore({2, 1}, std::nullopt), UsageError);
  SweepSchedule second(e, {2, 2}, half_range);
  EXPECT_THROW(second.restore({0, 1}, std::nullopt), UsageError);
}

TEST(SweepSchedule, ShardsHaveEachRunOnceBetweenThem) {
  for (const bool with_precision : {false, true}) {
    const Experiment e = with_precision ? precise(5, 0.0, 20) : experiment(5, 7);
    std::multiset<Pair> all;
    for (const std::size_t index : {1U, 2U, 3U}) {
      SweepSchedule schedule(e, {index, 3}, half_range);
      const auto spread = [](const SweepTask& t) { return static_cast<double>(t.seed); };
      for (const Pair& run : run_all(schedule, 2, spread)) all.insert(run);
    }
    EXPECT_THAT(all, SizeIs(e.arms.size() * e.seeds.size()));
    EXPECT_THAT(std::set<Pair>(all.begin(), all.end()), SizeIs(all.size()));
  }
}

TEST(SweepSchedule, AShardMayHaveNothingToDo) {
  const Experiment e = experiment(1, 2);
  SweepSchedule schedule(e, {3, 3}, half_range);
  EXPECT_EQ(schedule.next(), std::nullopt);
  EXPECT_TRUE(schedule.is_done());
}

TEST(SweepSchedule, StopsAnArmAsSoonAsItIsPreciseEnough) {
  // Arm 0 always gives the same; arm 1 alternates.
  const Experiment e = precise(2, 0.5, 100);
  SweepSchedule schedule(e, {}, half_range);
  const auto result = [](const SweepTask& t) {
    return t.arm == 0 ? 3.0 : 10.0 * static_cast<double>(t.seed % 2);
  };
  std::size_t first = 0, second = 0;
  for (const auto& [arm, seed] : run_all(schedule, 3, result)) ++(arm == 0 ? first : second);
  EXPECT_EQ(first, 10U);
  EXPECT_EQ(second, 100U);
}

TEST(SweepSchedule, MakesTheSameRunsInWhateverOrderTheyEnd) {
  // Precise enough from the third batch on.
  const auto width = [](const std::vector<double>& v) { return v.size() < 30 ? 1.0 : 0.1; };
  const Experiment e = precise(3, 0.5, 100);
  std::set<Pair> before;
  for (const std::size_t jobs : {1U, 2U, 7U, 64U}) {
    SweepSchedule schedule(e, {}, width);
    const auto made = run_all(schedule, jobs, one);
    const std::set<Pair> runs(made.begin(), made.end());
    EXPECT_THAT(runs, SizeIs(90));
    if (jobs > 1) {
      EXPECT_EQ(runs, before);
    }
    before = runs;
  }
}

TEST(SweepSchedule, GoesOnToTheSameEndAfterAnInterruption) {
  const auto width = [](const std::vector<double>& v) { return v.size() < 30 ? 1.0 : 0.1; };
  const Experiment e = precise(2, 0.5, 100);
  SweepSchedule undisturbed(e, {}, width);
  const auto all = run_all(undisturbed, 3, one);
  for (std::size_t kept = 0; kept <= all.size(); ++kept) {
    SweepSchedule schedule(e, {}, width);
    std::set<Pair> runs(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(kept));
    for (const auto& [arm, seed] : runs) schedule.restore({arm, seed}, 1.0);
    for (const Pair& run : run_all(schedule, 2, one)) EXPECT_TRUE(runs.insert(run).second);
    EXPECT_EQ(runs, std::set<Pair>(all.begin(), all.end()));
  }
}

TEST(SweepSchedule, FailedRunsCountAsRunsButNotAsResults) {
  std::vector<std::size_t> looked_at;
  const auto width = [&](const std::vector<double>& v) {
    looked_at.push_back(v.size());
    return 1.0;
  };
  const Experiment e = precise(1, 0.5, 20);
  SweepSchedule schedule(e, {}, width);
  const auto result = [](const SweepTask& t) {
    return t.seed % 2 == 0 ? std::optional(1.0) : std::nullopt;
  };
  EXPECT_THAT(run_all(schedule, 1, result), SizeIs(20));
  EXPECT_THAT(looked_at, ElementsAre(5U));  // after 10; 20 are the most
}

}  // namespace
}  // namespace tether
