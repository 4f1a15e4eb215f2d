// The only tests of common/ that wait for the wall clock. They assert what must hold on a busy
// machine too: order, instants, counts and "never early", not "soon".
#include "common/node/real_time_loop.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <stdexcept>
#include <thread>
#include <vector>

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;

/// A pipe that a test makes readable.
struct Pipe {
  Pipe() {
    if (pipe(ends.data()) != 0) throw std::runtime_error("cannot open a pipe");
  }
  ~Pipe() {
    close(ends[0]);
    close(ends[1]);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  int fd() const { return ends[0]; }
  void write_byte() { EXPECT_EQ(write(ends[1], "x", 1), 1); }
  void read_byte() {
    char c = 0;
    EXPECT_EQ(read(ends[0], &c, 1), 1);
  }

  std::array<int, 2> ends{};
};

struct RealTimeLoopTest : testing::Test {
  /// A loop in which nothing happens ends here instead of hanging.
  void run() { loop.run_until(loop.now() + 20s); }
  void stop_after(Duration d) {
    loop.at(loop.now() + d, Priority::observer, [this](Instant) { loop.stop(); });
  }

  RealTimeLoop loop{RealTimeLoop::wall_utime_us()};
};

TEST_F(RealTimeLoopTest, PeriodicTasksDoNotDriftAndAreNeverEarly) {
  const Instant first = loop.now() + 10ms;
  std::vector<Instant> instants;
  loop.every(first, 5ms, Priority::node, [&](Instant scheduled) {
    EXPECT_GE(loop.now(), scheduled);
    instants.push_back(scheduled);
    if (instants.size() == 60) loop.stop();
  });
  run();
  ASSERT_EQ(instants.size(), 60U);
  for (std::size_t i = 0; i < instants.size(); ++i) {
    EXPECT_EQ(instants[i], first + i * 5ms);
  }
}

TEST(RealTimeLoopInSlowMotion, TakesSoManyTimesLongerAndKeepsTheRunsOwnTime) {
  RealTimeLoop slow(RealTimeLoop::wall_utime_us(), 0.1);
  EXPECT_EQ(slow.rate(), 0.1);
  slow.set_now(kStart + 7s, 7);
  const auto began = std::chrono::steady_clock::now();
  std::vector<Instant> instants;
  slow.every(kStart + 7005ms, 5ms, Priority::node, [&](Instant scheduled) {
    EXPECT_GE(slow.now(), scheduled);
    instants.push_back(scheduled);
    if (instants.size() == 3) slow.stop();
  });
  slow.run_until(kStart + 9s);
  const auto took = std::chrono::steady_clock::now() - began;
  EXPECT_THAT(instants, ElementsAre(kStart + 7005ms, kStart + 7010ms, kStart + 7015ms));
  EXPECT_GE(took, 149ms);
  EXPECT_LT(slow.now(), kStart + 8s);  // ten seconds of wall time at most
}

TEST_F(RealTimeLoopTest, EveryMissedPeriodIsDeliveredAndLatenessCountsAsSlips) {
  const Instant first = loop.now() + 10ms;
  std::vector<Instant> instants;
  loop.every(first, 10ms, Priority::node, [&](Instant scheduled) {
    instants.push_back(scheduled);
    if (instants.size() == 1) std::this_thread::sleep_for(65ms);
    if (instants.size() == 10) loop.stop();
  });
  run();
  ASSERT_EQ(instants.size(), 10U);
  for (std::size_t i = 0; i < instants.size(); ++i) {
    EXPECT_EQ(instants[i], first + i * 10ms);
  }
  // The periods at 10, 20, 30, 40 and 50 ms after the first start at 65 ms or later.
  EXPECT_GE(loop.slips(), 5U);
  EXPECT_GE(loop.lateness_max(), 55ms);
}

TEST_F(RealTimeLoopTest, LatenessOfAPauseIsHalfItsSquareHoweverManyTasksItDelays) {
  for (const int tasks : {1, 5}) {
    RealTimeLoop fresh(RealTimeLoop::wall_utime_us() - 1'000'000);
    for (int i = 0; i < tasks; ++i) fresh.every(fresh.now(), 10ms, Priority::node, [](Instant) {});
    fresh.at(fresh.now() + 105ms, Priority::node,
             [](Instant) { std::this_thread::sleep_for(205ms); });
    fresh.run_until(fresh.now() + 500ms);
    EXPECT_GE(fresh.lateness_s2(), 0.5 * 0.2 * 0.2 * 0.95) << tasks;
    EXPECT_LE(fresh.lateness_s2(), 0.5 * 0.3 * 0.3) << tasks;  // limit for a busy machine
  }
}

TEST_F(RealTimeLoopTest, LatenessBeforeTheRunsStartDoesNotCount) {
  RealTimeLoop fresh(RealTimeLoop::wall_utime_us() + 3'600'000'000);
  fresh.every(fresh.now(), 10ms, Priority::node, [](Instant) {});
  fresh.at(fresh.now() + 15ms, Priority::node, [](Instant) { std::this_thread::sleep_for(100ms); });
  fresh.run_until(fresh.now() + 200ms);
  EXPECT_EQ(fresh.lateness_s2(), 0.0);
}

TEST_F(RealTimeLoopTest, ASingleTaskThatIsLateIsNoSlip) {
  std::vector<Instant> instants;
  loop.at(loop.now() - 1s, Priority::node, [&](Instant t) { instants.push_back(t); });
  const Instant due = loop.now() - 1s;
  stop_after(1ms);
  run();
  ASSERT_EQ(instants.size(), 1U);
  EXPECT_NEAR(to_seconds(instants[0] - due), 0.0, 0.5);
  EXPECT_EQ(loop.slips(), 0U);
}

TEST_F(RealTimeLoopTest, ATaskThatIsAlwaysDueDoesNotStarveDescriptors) {
  Pipe pipe;
  pipe.write_byte();
  EventLoop::Task again = [&](Instant) { loop.at(loop.now(), Priority::physics, again); };
  again(loop.now());
  bool read = false;
  loop.add_fd(pipe.fd(), [&](Instant) {
    read = true;
    loop.stop();
  });
  run();
  EXPECT_TRUE(read);
}

TEST_F(RealTimeLoopTest, TerminationSignalsEndTheRun) {
  for (const int number : {SIGTERM, SIGINT}) {
    loop.at(loop.now(), Priority::node, [number](Instant) { kill(getpid(), number); });
    const Instant begin = loop.now();
    run();
    EXPECT_EQ(loop.signal(), number);
    EXPECT_LT(loop.now() - begin, 15s);
  }
}

TEST_F(RealTimeLoopTest, NoSignalIsReportedWhenTheEndComesFirst) {
  const Instant end = loop.now() + 10ms;
  loop.run_until(end);
  EXPECT_GE(loop.now(), end);
  EXPECT_EQ(loop.signal(), 0);
}

TEST_F(RealTimeLoopTest, CallsTheTaskOfADescriptorWhileItIsReadable) {
  Pipe pipe;
  int calls = 0;
  loop.add_fd(pipe.fd(), [&](Instant) {
    pipe.read_byte();
    if (++calls == 3) loop.stop();
  });
  loop.at(loop.now(), Priority::node, [&](Instant) {
    pipe.write_byte();
    pipe.write_byte();
  });
  loop.at(loop.now() + 5ms, Priority::node, [&](Instant) { pipe.write_byte(); });
  run();
  EXPECT_EQ(calls, 3);
}

TEST_F(RealTimeLoopTest, ADescriptorMayBeRemovedInsideItsOwnTask) {
  Pipe removed, other;
  int calls = 0, other_calls = 0;
  std::vector<int> state(100, 7);  // lives in the task, so a destroyed task would show
  loop.add_fd(removed.fd(), [&, state](Instant) {
    loop.remove_fd(removed.fd());
    ++calls;
    EXPECT_EQ(state[99], 7);
  });
  loop.add_fd(other.fd(), [&](Instant) {
    other.read_byte();
    if (++other_calls == 2) loop.stop();
  });
  removed.write_byte();
  other.write_byte();
  loop.at(loop.now() + 5ms, Priority::node, [&](Instant) { other.write_byte(); });
  run();
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(other_calls, 2);
}

TEST_F(RealTimeLoopTest, ATaskMayRemoveAnotherDescriptorThatIsReadableToo) {
  Pipe a, b;
  int calls = 0;
  loop.add_fd(a.fd(), [&](Instant) {
    ++calls;
    loop.remove_fd(b.fd());
    a.read_byte();
  });
  loop.add_fd(b.fd(), [&](Instant) {
    ++calls;
    loop.remove_fd(a.fd());
    b.read_byte();
  });
  a.write_byte();
  b.write_byte();
  stop_after(20ms);
  run();
  EXPECT_EQ(calls, 1);
}

TEST_F(RealTimeLoopTest, AReusedDescriptorNumberBelongsToTheNewTask) {
  int stale_calls = 0, calls = 0, number = -1;
  {
    Pipe closed_without_removal;
    number = closed_without_removal.fd();
    loop.add_fd(number, [&](Instant) { ++stale_calls; });
  }
  Pipe pipe;
  ASSERT_EQ(pipe.fd(), number);
  loop.add_fd(pipe.fd(), [&](Instant) {
    ++calls;
    loop.stop();
  });
  pipe.write_byte();
  run();
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(stale_calls, 0);
}

TEST_F(RealTimeLoopTest, ADescriptorThatCannotBeWatchedIsAnError) {
  EXPECT_THROW(loop.add_fd(-1, [](Instant) {}), std::system_error);
}

TEST_F(RealTimeLoopTest, WorkAsideDoesNotHoldUpTheLoop) {
  const auto here = std::this_thread::get_id();
  int periods = 0;
  loop.every(loop.now(), 5ms, Priority::node, [&](Instant) { ++periods; });
  loop.aside(
      [&] {
        EXPECT_NE(std::this_thread::get_id(), here);
        std::this_thread::sleep_for(200ms);
      },
      [&](Instant) {
        EXPECT_EQ(std::this_thread::get_id(), here);
        EXPECT_GE(periods, 5);
        loop.stop();
      });
  EXPECT_EQ(periods, 0);
  run();
  EXPECT_GE(periods, 5);
}

TEST_F(RealTimeLoopTest, ALoopThatEndsWaitsForTheWorkAside) {
  bool worked = false;
  {
    RealTimeLoop short_lived(RealTimeLoop::wall_utime_us());
    short_lived.aside(
        [&] {
          std::this_thread::sleep_for(50ms);
          worked = true;
        },
        [](Instant) { ADD_FAILURE() << "the loop is gone"; });
  }
  EXPECT_TRUE(worked);
}

TEST_F(RealTimeLoopTest, AnExceptionComesOutOfTheRunAndLeavesTheLoopUsable) {
  loop.at(loop.now(), Priority::node, [](Instant) { throw std::runtime_error("broken"); });
  EXPECT_THROW(run(), std::runtime_error);
  bool ran = false;
  loop.at(loop.now(), Priority::node, [&](Instant) {
    ran = true;
    loop.stop();
  });
  run();
  EXPECT_TRUE(ran);
}

TEST_F(RealTimeLoopTest, TheClockCanBeMovedToAnothers) {
  loop.set_now(kStart + 1h, 7);
  EXPECT_EQ(loop.run_id(), 7);
  EXPECT_GE(loop.now(), kStart + 1h);
  EXPECT_LT(loop.now(), kStart + 1h + 10s);
  const Instant due = loop.now() + 5ms;
  bool ran = false;
  loop.at(due, Priority::node, [&](Instant) {
    ran = true;
    EXPECT_GE(loop.now(), due);
    loop.stop();
  });
  run();
  EXPECT_TRUE(ran);
}

TEST(RealTimeLoopStart, TimeIsNegativeBeforeAStartInTheFuture) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us() + 3'600'000'000);
  EXPECT_LT(loop.now(), kStart - 3'590s);
  EXPECT_GE(loop.now(), kStart - 3'600s);
  std::vector<Instant> instants;
  const Instant due = loop.now() + 5ms;
  loop.at(due, Priority::node, [&](Instant t) {
    instants.push_back(t);
    loop.stop();
  });
  loop.run_until(kStart - 3'500s);
  EXPECT_THAT(instants, ElementsAre(due));
  EXPECT_LT(loop.now(), kStart);
}

TEST(RealTimeLoopStart, APeriodicTaskThatJoinsLateStartsAtTheNextPeriod) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us() - 3'600'000'000);
  EXPECT_GE(loop.now(), kStart + 3'600s);
  const Instant joined = loop.now();
  std::vector<Instant> instants;
  loop.every(kStart + 3ms, 20ms, Priority::node, [&](Instant t) {
    instants.push_back(t);
    if (instants.size() == 2) loop.stop();
  });
  loop.run_until(kStart + 3'700s);
  ASSERT_EQ(instants.size(), 2U);
  EXPECT_GE(instants[0], joined);
  EXPECT_EQ((instants[0] - kStart - 3ms) % 20ms, 0ms);
  EXPECT_EQ(instants[1] - instants[0], 20ms);
}

TEST(RealTimeLoopStart, TwoLoopsWithOneStartAgreeOnTheTime) {
  const std::int64_t start = RealTimeLoop::wall_utime_us() - 5'000'000;
  RealTimeLoop a(start), b(start);
  const Duration difference = b.now() - a.now();
  EXPECT_LT(difference, 1s);
  EXPECT_GT(difference, -1s);
}

}  // namespace
}  // namespace tether
