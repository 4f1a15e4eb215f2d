#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <map>
#include <string>
#include <utility>

#include "common/vehicle/actuator.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Refused plans, times of execution, and reports in poses.

namespace tether {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::seconds;
using test::at_s;
using test::plan;
constexpr Duration kBufferTick{1};
constexpr std::int64_t kAny = Plan::kBasedOnAny;

struct PlanBufferTest : ::testing::Test {
  PlanBuffer buffer{StopLimits{}, StreamGuard::Config{.earliest = at_s(-5)}};

  PlanFate offer(Instant now, const Plan& plan, PlanSource source = PlanSource::network) {
    return buffer.offer(now, source, plan);
  }
  /// v in force; −1 for no plan.
  double v_mps(Instant now) const {
    const auto twist = buffer.in_force(now);
    return twist ? twist->v_mps : -1.0;
  }
  std::map<std::string, std::int64_t> counters() const {
    CounterList list;
    buffer.list(list);
    return {list.begin(), list.end()};
  }
};

TEST_F(PlanBufferTest, HasNoPlanBeforeTheFirstTakesOver) {
  EXPECT_EQ(buffer.in_force(at_s(1)), std::nullopt);
  EXPECT_EQ(buffer.newest(), PlanName{});
  ASSERT_EQ(offer(at_s(1), plan(at_s(2), 4)), PlanFate::accepted);
  EXPECT_EQ(buffer.in_force(at_s(2) - kBufferTick), std::nullopt);
  EXPECT_EQ(v_mps(at_s(2)), 1.0);
}

TEST_F(PlanBufferTest, RefusesTwistsThatAreNotFiniteOrAbsurd) {
  constexpr double kBad[] = {std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(), -kLargestUsable};
  for (const double bad : kBad) {
    for (const std::size_t k : {0U, 9U}) {
      Plan forward = plan(at_s(1), 0), turning = plan(at_s(1), 0);
      forward.twists[k].v_mps = bad;
      turning.twists[k].omega_radps = bad;
      EXPECT_EQ(offer(at_s(1), forward), PlanFate::unusable);
      EXPECT_EQ(offer(at_s(1), turning), PlanFate::unusable);
    }
  }
  EXPECT_EQ(counters().at("plan.unusable"), 12);
  EXPECT_TRUE(buffer.empty());
}

TEST_F(PlanBufferTest, RefusesAPlanWithoutTwistsOrWithAnImpossibleName) {
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), 0, kAny, {}, 0)), PlanFate::unusable);
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), -1)), PlanFate::unusable);
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), 0, -3)), PlanFate::unusable);
  Plan p = plan(at_s(1), 0);
  p.name.session = -1;
  EXPECT_EQ(offer(at_s(1), p), PlanFate::unusable);
}

TEST_F(PlanBufferTest, RefusesTimeThatStandsStillOrRunsBackwards) {
  for (const Duration step : {Duration{0}, Duration{-1}, Duration{seconds{-2147}}}) {
    Plan p = plan(at_s(1), 0);
    p.step = step;
    EXPECT_EQ(offer(at_s(1), p), PlanFate::bad_step);
  }
}

TEST_F(PlanBufferTest, RefusesMoreTwistsOrALongerHorizonThanTheBounds) {
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), 0, kAny, {}, PlanBuffer::kMaxTwists + 1)),
            PlanFate::too_long);
  Plan p = plan(at_s(1), 0);  // ten twists
  p.step = PlanBuffer::kMaxHorizon / 10 + kBufferTick;
  EXPECT_EQ(offer(at_s(1), p), PlanFate::too_long);
  p.step = PlanBuffer::kMaxHorizon / 10;
  EXPECT_EQ(offer(at_s(1), p), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), 1, kAny, {}, PlanBuffer::kMaxTwists)), PlanFate::accepted);
}

TEST_F(PlanBufferTest, RefusesAStartTooFarAheadByTheSourcesMeasure) {
  Plan p = plan(at_s(1), 0);
  p.start = at_s(1) + PlanBuffer::kMaxAhead + kBufferTick;
  EXPECT_EQ(offer(at_s(1), p), PlanFate::too_early);
  EXPECT_EQ(offer(at_s(1), p, PlanSource::preload), PlanFate::accepted);
  p = plan(at_s(1), 1);
  p.start = at_s(1) + PlanBuffer::kMaxPreload + kBufferTick;
  EXPECT_EQ(offer(at_s(1), p, PlanSource::preload), PlanFate::too_early);
  p.seq = 2;
  p.start = at_s(1) + PlanBuffer::kMaxAhead;
  EXPECT_EQ(offer(at_s(1), p), PlanFate::accepted);
}

TEST_F(PlanBufferTest, SurvivesTheLargestTimesOnTheWire) {
  for (const std::int64_t utime : {INT64_MIN, INT64_MAX}) {
    Plan p = plan(at_s(1), 0);
    p.start = from_utime(utime);
    p.seq = utime > 0 ? 1 : 0;
    EXPECT_EQ(offer(at_s(1), p), utime > 0 ? PlanFate::too_early : PlanFate::expired);
  }
}

TEST_F(PlanBufferTest, RefusesAPlanThatIsOverAndNotOneThatIsAboutToBe) {
  EXPECT_EQ(offer(at_s(2), plan(at_s(1), 0)), PlanFate::expired);
  EXPECT_EQ(offer(at_s(2) - kBufferTick, plan(at_s(1), 1)), PlanFate::accepted);
}

TEST_F(PlanBufferTest, APlanThatComesLateBeginsInItsMiddle) {
  Plan p = plan(at_s(1), 0);
  for (std::size_t k = 0; k < 10; ++k) p.twists[k].v_mps = static_cast<double>(k);
  ASSERT_EQ(offer(at_s(1.45), p), PlanFate::accepted);
  EXPECT_EQ(v_mps(at_s(1.45)), 4.0);
}

TEST_F(PlanBufferTest, PlansThatStartLaterWaitWhileTheOldOneGoesOn) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0, kAny, {0.1, 0.0})), PlanFate::accepted);
  for (int i = 1; i <= 3; ++i) {  // each is sent before the one before it takes over
    const Instant start = at_s(1.0 + 0.2 * i);
    ASSERT_EQ(offer(at_s(1.0 + 0.05 * i), plan(start, i, kAny, {0.1 + i, 0.0})),
              PlanFate::accepted);
    EXPECT_EQ(buffer.newest(), (PlanName{7, i}));
  }
  EXPECT_EQ(v_mps(at_s(1.2) - kBufferTick), 0.1);
  EXPECT_EQ(v_mps(at_s(1.2)), 1.1);
  EXPECT_EQ(v_mps(at_s(1.4)), 2.1);
  EXPECT_EQ(v_mps(at_s(1.6)), 3.1);
}

TEST_F(PlanBufferTest, AStopEndsAllPlansAndThoseDecidedBeforeIt) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0)), PlanFate::accepted);
  ASSERT_EQ(offer(at_s(1), plan(at_s(1.5), 1, kAny)), PlanFate::accepted);
  buffer.stop(at_s(2));
  EXPECT_EQ(buffer.in_force(at_s(2)), std::nullopt);
  EXPECT_EQ(buffer.newest(), PlanName{});
  Plan late = plan(at_s(2), 2, kAny);
  late.stamp = at_s(2) - kBufferTick;
  EXPECT_EQ(offer(at_s(2), late), PlanFate::before_stop);
  EXPECT_EQ(counters().at("plan.before_stop"), 1);
  Plan next = plan(at_s(2), 3, kAny);
  next.stamp = at_s(2);
  EXPECT_EQ(offer(at_s(2), next), PlanFate::accepted);
}

TEST_F(PlanBufferTest, WherePlansNeedPosesTheyNeedAFreshOneNotOlderThanTheLast) {
  buffer.need_poses(seconds{1});
  EXPECT_EQ(buffer.seen(), std::nullopt);
  Plan p = plan(at_s(2), 0);
  p.pose.reset();
  EXPECT_EQ(offer(at_s(2), p), PlanFate::without_pose);
  p = plan(at_s(2), 1);
  p.pose = at_s(1);
  EXPECT_EQ(offer(at_s(2), p), PlanFate::blind);
  p.seq = 2;
  p.pose = at_s(1) + kBufferTick;
  EXPECT_EQ(offer(at_s(2), p), PlanFate::accepted);
  EXPECT_EQ(buffer.seen(), at_s(1) + kBufferTick);
  p.seq = p.name.id = 3;
  p.pose = at_s(1);
  EXPECT_EQ(offer(at_s(2), p), PlanFate::older_pose);
  EXPECT_EQ(buffer.seen(), at_s(1) + kBufferTick);
}

TEST_F(PlanBufferTest, WhileAnyStopIsAcceptedItNeedsNoPoseAndTellsNothingOfTheVehicle) {
  buffer.need_poses(seconds{1});
  ASSERT_EQ(offer(at_s(2), plan(at_s(2), 0)), PlanFate::accepted);
  const auto seen = buffer.seen();
  Plan stop = plan(at_s(2), 1);
  stop.twists.assign(3, Twist{});
  stop.pose.reset();
  EXPECT_EQ(offer(at_s(2), stop), PlanFate::without_pose);
  buffer.accept_any_stop(true);
  stop.seq = stop.name.id = 3;
  EXPECT_EQ(offer(at_s(2), stop), PlanFate::accepted);
  stop.seq = stop.name.id = 4;
  stop.pose = at_s(0);
  EXPECT_EQ(offer(at_s(2), stop), PlanFate::accepted);
  EXPECT_EQ(buffer.seen(), seen);
  EXPECT_EQ(buffer.in_force(at_s(2))->v_mps, 0.0);
}

TEST_F(PlanBufferTest, WhileItsSessionIsHeldNoOtherTakesOver) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0)), PlanFate::accepted);
  Plan other = plan(at_s(2), 1);
  other.name.session = 8;
  buffer.hold_session(true);
  EXPECT_EQ(offer(at_s(2), other), PlanFate::other_session);
  EXPECT_EQ(buffer.session(), 7);
  buffer.hold_session(false);
  EXPECT_EQ(offer(at_s(2), other), PlanFate::accepted);
  EXPECT_EQ(buffer.session(), 8);
}

TEST_F(PlanBufferTest, APlanThrowsAwayWhatWouldTakeOverLaterAndLeavesTheRest) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0, kAny, {0.1, 0.0})), PlanFate::accepted);
  ASSERT_EQ(offer(at_s(1), plan(at_s(1.2), 1, kAny, {0.2, 0.0})), PlanFate::accepted);
  ASSERT_EQ(offer(at_s(1), plan(at_s(1.6), 2, kAny, {0.3, 0.0})), PlanFate::accepted);
  Plan earlier = plan(at_s(1.4), 3, kAny, {0.4, 0.0});
  earlier.stamp = at_s(1.6);
  ASSERT_EQ(offer(at_s(1), earlier), PlanFate::accepted);
  EXPECT_EQ(v_mps(at_s(1.2)), 0.2);
  EXPECT_EQ(v_mps(at_s(1.4)), 0.4);
  EXPECT_EQ(v_mps(at_s(1.7)), 0.4);
  EXPECT_EQ(buffer.newest(), (PlanName{7, 3}));
}

TEST_F(PlanBufferTest, TheScheduleHasABoundAndRoomAgainWhenTimeHasPassed) {
  constexpr auto kMax = static_cast<std::int64_t>(PlanBuffer::kMaxWaiting);
  for (std::int64_t id = 0; id < kMax; ++id) {
    Plan p = plan(at_s(2) + id * milliseconds{100}, id);
    p.stamp = at_s(1);
    ASSERT_EQ(offer(at_s(1), p), PlanFate::accepted);
  }
  Plan p = plan(at_s(2) + kMax * milliseconds{100}, kMax);
  p.stamp = at_s(1);
  EXPECT_EQ(offer(at_s(1), p), PlanFate::overfull);
  p.seq = kMax + 1;
  EXPECT_EQ(offer(at_s(2), p), PlanFate::accepted) << "the first has taken over";
}

TEST_F(PlanBufferTest, ThePlanStaysInForceWhenItsHorizonIsOver) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0)), PlanFate::accepted);
  const Instant much_later = kStart + hours{5};
  EXPECT_EQ(v_mps(much_later), 0.0);
  EXPECT_EQ(buffer.newest(), (PlanName{7, 0}));
  EXPECT_EQ(offer(much_later, plan(much_later, 1, 0)), PlanFate::accepted);
  EXPECT_EQ(v_mps(much_later), 1.0);
}

TEST_F(PlanBufferTest, CountsWhatItReceivedOnceEach) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 1)), PlanFate::accepted);
  offer(at_s(1), plan(at_s(1), 1));                 // the same packet
  offer(at_s(1), plan(at_s(0.9), 0));               // overtaken
  offer(at_s(1), plan(at_s(0.95), 2));              // the clock went back
  offer(at_s(1), plan(at_s(2) + kBufferTick, 3));   // stamped ahead
  offer(at_s(1), plan(at_s(-5) - kBufferTick, 3));  // a plan of another run
  Plan negative = plan(at_s(1.5), 4);
  negative.seq = -1;
  offer(at_s(1.5), negative);
  Plan again = plan(at_s(1), 1);  // the same plan in another packet
  again.seq = 5;
  offer(at_s(1.5), again);
  offer(at_s(1.5), plan(at_s(1.5), 9, 8));  // based on what never was
  const auto counted = counters();
  for (const char* reason : {"accepted", "duplicated", "reordered", "time_backwards", "from_future",
                             "before_start", "invalid_seq", "repeated", "inconsistent"}) {
    EXPECT_EQ(counted.at(std::string("plan.") + reason), 1) << reason;
  }
  EXPECT_EQ(counted.at("plan.received"), 9);
  EXPECT_EQ(counted.at("plan.missed"), 3 + 3);  // 2, 3, 4 and 6, 7, 8
}

}  // namespace
}  // namespace tether
