#include "common/node/virtual_loop.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;

struct VirtualLoopTest : testing::Test {
  EventLoop::Task note(const std::string& what) {
    return [this, what](Instant) { log.push_back(what); };
  }
  void at(Duration when, const std::string& what, Priority priority = Priority::node) {
    loop.at(kStart + when, priority, note(what));
  }
  /// Notes the milliseconds of every call.
  EventLoop::Task note_time() {
    return [this](Instant t) { times.push_back((t - kStart) / 1ms); };
  }
  void run(Duration end) { loop.run_until(kStart + end); }

  VirtualLoop loop;
  std::vector<std::string> log;
  std::vector<std::int64_t> times;
};

TEST_F(VirtualLoopTest, RunsTasksInOrderOfTimeWhateverTheOrderOfInsertion) {
  at(3ms, "third");
  at(1ms, "first");
  at(2ms, "second");
  run(10ms);
  EXPECT_THAT(log, ElementsAre("first", "second", "third"));
}

TEST_F(VirtualLoopTest, RunsPhysicsThenDeliveryThenNodesThenObserversAtOneInstant) {
  at(1ms, "observer", Priority::observer);
  at(1ms, "node", Priority::node);
  at(1ms, "delivery", Priority::delivery);
  at(1ms, "physics", Priority::physics);
  run(1ms);
  EXPECT_THAT(log, ElementsAre("physics", "delivery", "node", "observer"));
}

TEST_F(VirtualLoopTest, TimeComesBeforePriority) {
  at(2ms, "physics", Priority::physics);
  at(1ms, "observer", Priority::observer);
  run(2ms);
  EXPECT_THAT(log, ElementsAre("observer", "physics"));
}

TEST_F(VirtualLoopTest, RunsTasksOfOneInstantAndPriorityInOrderOfInsertion) {
  std::vector<int> order, expected;
  for (int i = 0; i < 100; ++i) {
    loop.at(kStart + 1ms, Priority::node, [&order, i](Instant) { order.push_back(i); });
    expected.push_back(i);
  }
  run(1ms);
  EXPECT_EQ(order, expected);
}

TEST_F(VirtualLoopTest, ATaskSeesTheInstantThatItWasScheduledForAsNow) {
  std::vector<Instant> seen;
  loop.at(kStart + 7ns, Priority::node, [&](Instant scheduled) {
    EXPECT_EQ(scheduled, loop.now());
    seen.push_back(scheduled);
  });
  run(1ms);
  EXPECT_THAT(seen, ElementsAre(kStart + 7ns));
}

TEST_F(VirtualLoopTest, ATaskForThePastRunsNow) {
  run(5ms);
  loop.at(kStart + 1ms, Priority::node, note_time());
  run(5ms);
  EXPECT_THAT(times, ElementsAre(5));
  EXPECT_EQ(loop.now(), kStart + 5ms);
}

TEST_F(VirtualLoopTest, ATaskMayAddTasksForTheSameInstantAndForLater) {
  loop.at(kStart + 1ms, Priority::node, [this](Instant) {
    log.push_back("parent");
    at(1ms, "same instant");
    at(2ms, "later");
    at(1ms, "same instant, physics", Priority::physics);
  });
  at(1ms, "sibling");
  run(2ms);
  EXPECT_THAT(log,
              ElementsAre("parent", "same instant, physics", "sibling", "same instant", "later"));
}

TEST_F(VirtualLoopTest, TasksThatAddTasksOfTheirInstantAlwaysLeaveTheFirstOfAllToRunNext) {
  const std::vector<Priority> all{Priority::physics, Priority::delivery, Priority::node,
                                  Priority::observer};
  std::set<std::pair<Priority, int>> pending;
  std::mt19937 random{1};
  int added = 0, run_so_far = 0;
  const std::function<void()> add = [&] {
    const std::pair<Priority, int> place{all[random() % all.size()], added++};
    pending.insert(place);
    loop.at(kStart + 1ms, place.first, [&, place](Instant) {
      EXPECT_EQ(place, *pending.begin());
      pending.erase(place);
      ++run_so_far;
      for (auto more = random() % 3; more > 0 && added < 1000; --more) add();
    });
  };
  for (int i = 0; i < 50; ++i) add();
  run(1ms);
  EXPECT_EQ(run_so_far, added);
  EXPECT_THAT(pending, IsEmpty());
}

TEST_F(VirtualLoopTest, ATaskKeepsItsStateWhileItAddsManyTasks) {
  const std::string state(100, 's');
  int added = 0;
  loop.every(kStart, 1ms, Priority::node, [&, state](Instant t) {
    for (int i = 0; i < 1000; ++i) {
      loop.at(t, Priority::observer, [&added](Instant) { ++added; });
    }
    log.push_back(state);
  });
  run(2ms);
  EXPECT_THAT(log, ElementsAre(state, state, state));
  EXPECT_EQ(added, 3000);
}

TEST_F(VirtualLoopTest, RunsUpToAndIncludingTheEndAndThenIsThere) {
  at(10ms, "at the end");
  at(10ms + 1ns, "one nanosecond later");
  run(10ms);
  EXPECT_THAT(log, ElementsAre("at the end"));
  EXPECT_EQ(loop.now(), kStart + 10ms);
  run(10ms + 1ns);
  EXPECT_THAT(log, ElementsAre("at the end", "one nanosecond later"));
}

TEST_F(VirtualLoopTest, APeriodicTaskRunsAtFirstAndThenEveryPeriod) {
  loop.every(kStart + 3ms, 10ms, Priority::node, note_time());
  run(23ms);
  EXPECT_THAT(times, ElementsAre(3, 13, 23));
}

TEST_F(VirtualLoopTest, APeriodicTaskGoesOnWhereTheLastRunEnded) {
  loop.every(kStart, 10ms, Priority::node, note_time());
  run(10ms);
  run(10ms);
  run(25ms);
  EXPECT_THAT(times, ElementsAre(0, 10, 20));
}

TEST_F(VirtualLoopTest, APeriodicTaskThatJoinsLateStartsAtTheNextPeriod) {
  run(25ms);
  loop.every(kStart, 10ms, Priority::node, note_time());
  run(45ms);
  EXPECT_THAT(times, ElementsAre(30, 40));
}

TEST_F(VirtualLoopTest, APeriodicTaskThatJoinsOnAPeriodStartsAtOnce) {
  run(20ms);
  loop.every(kStart, 10ms, Priority::node, note_time());
  run(30ms);
  EXPECT_THAT(times, ElementsAre(20, 30));
}

TEST_F(VirtualLoopTest, PeriodicTasksOfOneInstantKeepTheirOrderForGood) {
  loop.every(kStart, 1ms, Priority::node, note("a"));
  loop.every(kStart, 1ms, Priority::node, note("b"));
  run(2ms);
  EXPECT_THAT(log, ElementsAre("a", "b", "a", "b", "a", "b"));
}

TEST_F(VirtualLoopTest, StopEndsTheRunAfterTheCurrentTask) {
  loop.at(kStart + 1ms, Priority::node, [this](Instant) {
    loop.stop();
    log.push_back("stopping");
  });
  at(1ms, "same instant");
  at(2ms, "later");
  run(10ms);
  EXPECT_THAT(log, ElementsAre("stopping"));
  EXPECT_EQ(loop.now(), kStart + 1ms);
  run(10ms);
  EXPECT_THAT(log, ElementsAre("stopping", "same instant", "later"));
  EXPECT_EQ(loop.now(), kStart + 10ms);
}

TEST_F(VirtualLoopTest, AnExceptionComesOutOfTheRunAndLeavesTheOtherTasks) {
  loop.at(kStart + 1ms, Priority::node, [](Instant) { throw std::runtime_error("broken"); });
  loop.every(kStart, 2ms, Priority::node, note_time());
  EXPECT_THROW(run(10ms), std::runtime_error);
  EXPECT_EQ(loop.now(), kStart + 1ms);
  run(4ms);
  EXPECT_THAT(times, ElementsAre(0, 2, 4));
}

TEST_F(VirtualLoopTest, APeriodicTaskThatThrewIsNotRunAgain) {
  int calls = 0;
  loop.every(kStart, 1ms, Priority::node, [&calls](Instant) {
    if (++calls == 2) throw std::runtime_error("broken");
  });
  EXPECT_THROW(run(10ms), std::runtime_error);
  at(5ms, "another task in its place");
  run(10ms);
  EXPECT_EQ(calls, 2);
  EXPECT_THAT(log, ElementsAre("another task in its place"));
}

TEST_F(VirtualLoopTest, ARunIntoThePastDoesNothing) {
  run(5ms);
  at(5ms, "now");
  run(4ms);
  EXPECT_EQ(loop.now(), kStart + 5ms);
  EXPECT_THAT(log, IsEmpty());
}

TEST_F(VirtualLoopTest, AnEndlessRunReturnsWhenNothingIsLeftToDo) {
  at(1ms, "only task");
  loop.run_until(Instant::max());
  EXPECT_THAT(log, ElementsAre("only task"));
}

TEST_F(VirtualLoopTest, HasNoFileDescriptorsAndNeverSlips) {
  EXPECT_THROW(loop.add_fd(0, note("readable")), std::logic_error);
  EXPECT_EQ(loop.slips(), 0U);
}

}  // namespace
}  // namespace tether
