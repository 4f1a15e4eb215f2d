#include "common/node/stream_guard.hpp"

#include <gmock/gmock.h>

#include <cstdint>
#include <string>
#include <utility>

namespace tether {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Pair;

struct StreamGuardTest : testing::Test {
  bool accept(Duration stamp, std::int64_t seq) { return guard.accept(now, kStart + stamp, seq); }

  /// The counters that are not zero.
  CounterList counted() const {
    CounterList all, some;
    guard.list("pose", all);
    for (auto& entry : all) {
      if (entry.second != 0) some.push_back(entry);
    }
    return some;
  }

  Instant now = kStart + 10s;
  StreamGuard guard;
};

TEST_F(StreamGuardTest, AcceptsMessagesInOrder) {
  EXPECT_TRUE(accept(1s, 0));
  EXPECT_TRUE(accept(2s, 1));
  EXPECT_TRUE(accept(3s, 2));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 3)));
}

TEST_F(StreamGuardTest, CountsNothingBeforeTheFirstMessage) {
  EXPECT_THAT(counted(), IsEmpty());
  EXPECT_EQ(guard.counters().accepted, 0);
}

TEST_F(StreamGuardTest, TheFirstMessageMayHaveAnyNumberAndBeAsOldAsTheRun) {
  EXPECT_TRUE(accept(0s, 1'000'000));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1)));
}

TEST_F(StreamGuardTest, RejectsAMessageStampedBeforeTheRunsStart) {
  EXPECT_FALSE(accept(-1ns, 0));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.before_start", 1)));
}

TEST_F(StreamGuardTest, AcceptsAMessageStampedExactlyTheLimitAhead) {
  EXPECT_TRUE(accept(11s, 0));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1)));
}

TEST_F(StreamGuardTest, RejectsAMessageStampedOneNanosecondTooFarAhead) {
  EXPECT_FALSE(accept(11s + 1ns, 0));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.from_future", 1)));
}

TEST_F(StreamGuardTest, TheLimitIsConfigurable) {
  guard = StreamGuard({.max_ahead = 0ns});
  EXPECT_FALSE(accept(10s + 1ns, 0));
  EXPECT_TRUE(accept(10s, 0));
}

TEST_F(StreamGuardTest, RejectsTheNewestMessageAgain) {
  EXPECT_TRUE(accept(1s, 5));
  EXPECT_FALSE(accept(1s, 5));
  EXPECT_FALSE(accept(1s, 5));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.duplicated", 2)));
}

TEST_F(StreamGuardTest, RejectsAnEarlierMessageThatComesLate) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(1s, 5));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.reordered", 1)));
}

TEST_F(StreamGuardTest, RejectsALowerNumberWithTheSameStamp) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(2s, 5));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.reordered", 1)));
}

TEST_F(StreamGuardTest, RejectsTheSameNumberWithAnEarlierStamp) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(2s - 1ns, 6));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.reordered", 1)));
}

TEST_F(StreamGuardTest, RejectsALaterNumberWithAnEarlierStamp) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(2s - 1ns, 7));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.time_backwards", 1)));
}

TEST_F(StreamGuardTest, AcceptsALaterNumberWithTheSameStamp) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_TRUE(accept(2s, 7));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 2)));
}

TEST_F(StreamGuardTest, RejectsANegativeNumber) {
  EXPECT_FALSE(accept(1s, -1));
  EXPECT_FALSE(accept(1s, INT64_MIN));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.invalid_seq", 2)));
}

TEST_F(StreamGuardTest, CountsTheNumbersThatWereSkipped) {
  EXPECT_TRUE(accept(1s, 3));
  EXPECT_TRUE(accept(2s, 4));
  EXPECT_TRUE(accept(3s, 10));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 3), Pair("pose.missed", 5)));
}

TEST_F(StreamGuardTest, ALowerNumberWithALaterStampIsARestartedPublisher) {
  EXPECT_TRUE(accept(1s, 100));
  EXPECT_TRUE(accept(1s + 1ns, 0));
  EXPECT_TRUE(accept(2s, 1));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 3), Pair("pose.restarts", 1)));
}

TEST_F(StreamGuardTest, APublisherMayRestartAfterItsVeryFirstMessage) {
  EXPECT_TRUE(accept(1s, 0));
  EXPECT_TRUE(accept(2s, 0));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 2), Pair("pose.restarts", 1)));
}

TEST_F(StreamGuardTest, OnlyTheFirstRuleThatAppliesIsCounted) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(1h, -1));
  EXPECT_FALSE(accept(1h, 6));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 1), Pair("pose.from_future", 1),
                                     Pair("pose.invalid_seq", 1)));
}

TEST_F(StreamGuardTest, ARejectedMessageRefreshesNothing) {
  EXPECT_TRUE(accept(2s, 6));
  EXPECT_FALSE(accept(1h, 1000));  // from the future
  EXPECT_FALSE(accept(1s, 1000));  // time backwards
  EXPECT_FALSE(accept(1s, 3));     // reordered
  EXPECT_FALSE(accept(3s, -5));    // invalid
  EXPECT_FALSE(accept(2s, 6));     // duplicated
  EXPECT_TRUE(accept(2s + 1ns, 7));
  EXPECT_EQ(guard.counters().accepted, 2);
  EXPECT_EQ(guard.counters().missed, 0);
  EXPECT_EQ(guard.counters().restarts, 0);
}

TEST_F(StreamGuardTest, AStampFromTheFutureBecomesAcceptableWithTime) {
  EXPECT_FALSE(accept(12s, 0));
  now += 1s;
  EXPECT_TRUE(accept(12s, 0));
}

TEST_F(StreamGuardTest, ExtremesOfTheWireDoNotOverflow) {
  guard = StreamGuard({.counts_up = false});
  EXPECT_FALSE(guard.accept(now, from_utime(INT64_MAX), INT64_MAX));
  EXPECT_FALSE(guard.accept(now, from_utime(INT64_MIN), 0));
  EXPECT_TRUE(accept(0s, 0));
  EXPECT_TRUE(accept(1s, INT64_MAX));
  EXPECT_EQ(guard.counters().missed, INT64_MAX - 1);
  EXPECT_TRUE(accept(2s, 0));
  EXPECT_TRUE(accept(3s, INT64_MAX));
  EXPECT_EQ(guard.counters().missed, INT64_MAX);
  EXPECT_EQ(guard.counters().restarts, 1);
}

TEST_F(StreamGuardTest, RefusesAJumpThatNoLossExplainsAndGoesOnBelowIt) {
  EXPECT_TRUE(accept(1s, 7));
  for (const std::int64_t far : {std::int64_t{11'008}, std::int64_t{1} << 60, INT64_MAX}) {
    EXPECT_FALSE(accept(2s, far));
  }
  EXPECT_TRUE(accept(2s, 8));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 2), Pair("pose.jumped", 3)));
}

TEST_F(StreamGuardTest, AcceptsTheLargestGapThatTheFastestPublisherMayLeave) {
  EXPECT_TRUE(accept(1s, 0));
  EXPECT_TRUE(accept(1s, 1000));
  EXPECT_TRUE(accept(2s, 12'000));
  EXPECT_FALSE(accept(2s, 13'001));
  EXPECT_EQ(guard.counters().missed, 999 + 10'999);
}

TEST_F(StreamGuardTest, TwoMessagesInARowBeyondAJumpAreARestartedPublisher) {
  EXPECT_TRUE(accept(1s, 7));
  EXPECT_FALSE(accept(2s, 1'000'000));
  EXPECT_FALSE(accept(2s, 1'000'000));  // the same again is no second one
  EXPECT_TRUE(accept(2s + 50ms, 1'000'001));
  EXPECT_TRUE(accept(3s, 1'000'002));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 3), Pair("pose.jumped", 2),
                                     Pair("pose.restarts", 1)));
}

TEST_F(StreamGuardTest, ASecondJumpIsNoRestartUnlessItFollowsTheFirstInNumberAndTime) {
  EXPECT_TRUE(accept(1s, 7));
  EXPECT_FALSE(accept(2s, 1'000'000));
  EXPECT_FALSE(accept(2s + 1ms, 1'000'000));
  EXPECT_FALSE(accept(2s + 1ms, 1'000'001));
  EXPECT_FALSE(accept(2s + 2ms, 9'000'000));
  EXPECT_TRUE(accept(3s, 8));
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 2), Pair("pose.jumped", 4)));
}

TEST_F(StreamGuardTest, StrayJumpsBetweenMessagesOfTheStreamAreNeverARestart) {
  for (int i = 0; i < 100; ++i) {
    EXPECT_TRUE(accept(1s + i * 20ms, i));
    EXPECT_FALSE(accept(1s + i * 20ms + 1ms, 1'000'000 + i));
  }
  EXPECT_THAT(counted(), ElementsAre(Pair("pose.accepted", 100), Pair("pose.jumped", 100)));
}

TEST_F(StreamGuardTest, TheFirstMessageAfterALongSilenceMayBeFarAhead) {
  now += 1h;
  EXPECT_TRUE(accept(1s, 0));
  EXPECT_TRUE(accept(3601s, 36'000'000));
}

TEST_F(StreamGuardTest, ListsEveryCounterUnderItsPrefix) {
  CounterList all{{"before", 1}};
  guard.list("command", all);
  std::string names;
  for (const auto& [name, value] : all) names += name + " ";
  EXPECT_EQ(names,
            "before command.accepted command.duplicated command.reordered command.time_backwards "
            "command.from_future command.invalid_seq command.before_start command.restarts "
            "command.missed ");
}

}  // namespace
}  // namespace tether
