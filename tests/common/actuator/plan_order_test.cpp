#include <gtest/gtest.h>

#include <cstdint>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "common/vehicle/actuator.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/virtual_world.hpp"

// Permitted base plans, accepted senders, and that no loss ever excludes a controller.

namespace tether {
namespace {

using test::at_s;
using test::plan;
constexpr Duration kOrderTick{1};
constexpr std::int64_t kAnyRun = Plan::kBasedOnAny, kNone = Plan::kBasedOnNone;

struct PlanOrderTest : ::testing::Test {
  PlanBuffer buffer{StopLimits{}, StreamGuard::Config{}};

  PlanFate offer(Instant now, const Plan& plan, PlanSource source = PlanSource::network) {
    return buffer.offer(now, source, plan);
  }
  PlanFate offer_in(std::int64_t session, Instant now, std::int64_t id, std::int64_t based_on) {
    Plan p = plan(now, id, based_on);
    p.name.session = session;
    return offer(now, p);
  }
};

TEST_F(PlanOrderTest, APlanMustBeBasedOnThePlanInForce) {
  EXPECT_EQ(offer(at_s(1), plan(at_s(1), 0, 3)), PlanFate::other_session) << "none is followed";
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 1, kNone)), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(1.1), plan(at_s(1.1), 2, kNone)), PlanFate::inconsistent);
  EXPECT_EQ(offer(at_s(1.2), plan(at_s(1.2), 3, 2)), PlanFate::inconsistent);
  EXPECT_EQ(offer(at_s(1.3), plan(at_s(1.3), 4, 1)), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(1.4), plan(at_s(1.4), 5, 1)), PlanFate::inconsistent) << "4 is in force";
  EXPECT_EQ(offer(at_s(1.5), plan(at_s(1.5), 6, kAnyRun)), PlanFate::accepted);
  EXPECT_EQ(buffer.newest(), (PlanName{7, 6}));
}

TEST_F(PlanOrderTest, WhileAPlanWaitsItsSuccessorIsBasedOnIt) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 0, kNone)), PlanFate::accepted);
  Plan waiting = plan(at_s(1.5), 1, 0);
  waiting.stamp = at_s(1.1);
  ASSERT_EQ(offer(at_s(1.1), waiting), PlanFate::accepted);
  EXPECT_EQ(buffer.newest(), (PlanName{7, 1})) << "reported although it waits";
  Plan after = plan(at_s(1.6), 2, 0);
  after.stamp = at_s(1.2);
  EXPECT_EQ(offer(at_s(1.2), after), PlanFate::inconsistent) << "1 will be in force by then";
  after.seq = after.name.id = 3;
  after.based_on = after.based_on_last = 1;
  EXPECT_EQ(offer(at_s(1.2), after), PlanFate::accepted);
}

TEST_F(PlanOrderTest, APlanThatStartsBeforeAWaitingOneIsBasedOnWhatIsInForceUntilThen) {
  for (const bool on_waiting : {false, true}) {
    PlanBuffer fresh{StopLimits{}, StreamGuard::Config{}};
    fresh.offer(at_s(1), PlanSource::network, plan(at_s(1), 0, kNone));
    Plan waiting = plan(at_s(1.5), 1, 0);
    waiting.stamp = at_s(1.1);
    fresh.offer(at_s(1.1), PlanSource::network, waiting);
    Plan before = plan(at_s(1.5) - kOrderTick, 2, on_waiting ? 1 : 0);
    before.stamp = at_s(1.2);
    EXPECT_EQ(fresh.offer(at_s(1.2), PlanSource::network, before),
              on_waiting ? PlanFate::inconsistent : PlanFate::accepted);
  }
}

TEST_F(PlanOrderTest, AtTheVeryTimeOfTakingOverBothFit) {
  for (const std::int64_t based_on : {0, 1}) {
    PlanBuffer fresh{StopLimits{}, StreamGuard::Config{}};
    fresh.offer(at_s(1), PlanSource::network, plan(at_s(1), 0, kNone));
    Plan waiting = plan(at_s(1.5), 1, 0);
    waiting.stamp = at_s(1.1);
    fresh.offer(at_s(1.1), PlanSource::network, waiting);
    Plan same_start = plan(at_s(1.5), 2, based_on);
    same_start.stamp = at_s(1.2);
    EXPECT_EQ(fresh.offer(at_s(1.2), PlanSource::network, same_start), PlanFate::accepted);
  }
}

/// Plan `id`, based on any that settled of those from `first` to `last`.
Plan extension(Instant start, std::int64_t id, std::int64_t first, std::int64_t last) {
  Plan p = plan(start, id, first);
  p.based_on_last = last;
  return p;
}

TEST_F(PlanOrderTest, ARangeFitsItsFirstAndItsLastPlanAndNoneBeyond) {
  struct Case {
    std::int64_t followed;
    PlanFate fate;
  };
  for (const Case& c :
       {Case{4, PlanFate::inconsistent}, Case{5, PlanFate::accepted}, Case{6, PlanFate::accepted},
        Case{8, PlanFate::accepted}, Case{9, PlanFate::inconsistent}}) {
    PlanBuffer fresh{StopLimits{}, StreamGuard::Config{}};
    Plan followed = plan(at_s(1), c.followed, kNone);
    followed.settled = at_s(1.2);
    fresh.offer(at_s(1), PlanSource::network, followed);
    EXPECT_EQ(fresh.offer(at_s(1.5), PlanSource::network, extension(at_s(1.5), 10, 5, 8)), c.fate)
        << c.followed;
  }
}

TEST_F(PlanOrderTest, ARangeFitsPlansThatHaveSettledAndAreNotOver) {
  struct Case {
    Instant start;
    PlanFate fate;
  };
  for (const Case& c :
       {Case{at_s(1.2) - kOrderTick, PlanFate::inconsistent}, Case{at_s(1.2), PlanFate::accepted},
        Case{at_s(2) - kOrderTick, PlanFate::accepted},  // it ends at 2 s
        Case{at_s(2), PlanFate::inconsistent}}) {
    PlanBuffer fresh{StopLimits{}, StreamGuard::Config{}};
    Plan followed = plan(at_s(1), 5, kNone);
    followed.settled = at_s(1.2);
    fresh.offer(at_s(1), PlanSource::network, followed);
    Plan waits = extension(c.start, 10, 4, 6);
    waits.stamp = at_s(1.1);
    EXPECT_EQ(fresh.offer(at_s(1.1), PlanSource::network, waits), c.fate) << to_seconds(c.start);
  }
}

TEST_F(PlanOrderTest, WhatArrivesLateMustFitAtItsArrival) {
  Plan followed = plan(at_s(1), 5, kNone);
  followed.settled = at_s(1.2);
  ASSERT_EQ(offer(at_s(1), followed), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(2), extension(at_s(1.5), 6, 4, 5)), PlanFate::inconsistent) << "5 is over";
}

TEST_F(PlanOrderTest, ARangeOfOnePlanFitsItAsItIs) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 5, kNone)), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(1.5), extension(at_s(1.5), 6, 4, 5)), PlanFate::inconsistent);
  EXPECT_EQ(offer(at_s(1.6), extension(at_s(1.6), 7, 5, 5)), PlanFate::accepted);
}

TEST_F(PlanOrderTest, ARangeOfAnotherSessionFitsNothing) {
  Plan followed = plan(at_s(1), 5, kNone);
  followed.settled = at_s(1);
  ASSERT_EQ(offer(at_s(1), followed), PlanFate::accepted);
  Plan other = extension(at_s(1.5), 10, 5, 8);
  other.name.session = 8;
  EXPECT_EQ(offer(at_s(1.5), other), PlanFate::other_session);
  EXPECT_EQ(offer(at_s(1.5), extension(at_s(1.5), 10, 5, 8)), PlanFate::accepted);
}

TEST_F(PlanOrderTest, RefusesRangesThatRunBackwardsOrHaveNoIds) {
  ASSERT_EQ(offer(at_s(1), plan(at_s(1), 5, kNone)), PlanFate::accepted);
  std::int64_t id = 6;
  for (const auto& [first, last] :
       {std::pair{5, 4}, {5, -1}, {5, -2}, {-1, 5}, {-2, 5}, {-1, -2}, {-2, -1}, {-3, -3}}) {
    EXPECT_EQ(offer(at_s(1.1), extension(at_s(1.1), id++, first, last)), PlanFate::unusable)
        << first << " to " << last;
  }
  EXPECT_EQ(buffer.count(PlanFate::unusable), 8);
}

TEST_F(PlanOrderTest, ThePreloadIsAPlanLikeOthersAndItsRepetitionIsKnown) {
  Plan first = plan(at_s(1), 0, kNone);
  first.stamp = at_s(0.5);
  ASSERT_EQ(offer(at_s(0.5), first, PlanSource::preload), PlanFate::accepted);
  EXPECT_EQ(offer(at_s(0.5), first), PlanFate::repeated) << "over the network, too";
  Plan rival = plan(at_s(1.1), 1, kNone);
  rival.stamp = at_s(0.6);
  EXPECT_EQ(offer(at_s(0.6), rival), PlanFate::inconsistent);
  EXPECT_EQ(offer(at_s(1.1), plan(at_s(1.1), 2, 0)), PlanFate::accepted);
}

TEST_F(PlanOrderTest, ANewSessionTakesOverWithAPlanBasedOnNoneOrAnyOnly) {
  ASSERT_EQ(offer_in(7, at_s(1), 0, kNone), PlanFate::accepted);
  EXPECT_EQ(offer_in(8, at_s(1.1), 0, 0), PlanFate::other_session) << "0 is another session's";
  EXPECT_EQ(offer_in(8, at_s(1.2), 1, kNone), PlanFate::accepted);
  EXPECT_EQ(buffer.newest(), (PlanName{8, 1}));
  EXPECT_EQ(offer_in(9, at_s(1.3), 1, kAnyRun), PlanFate::accepted);
}

TEST_F(PlanOrderTest, PlansOfASupersededSessionAreRefused) {
  ASSERT_EQ(offer_in(7, at_s(1), 0, kAnyRun), PlanFate::accepted);
  ASSERT_EQ(offer_in(8, at_s(1.1), 0, kAnyRun), PlanFate::accepted);
  for (int i = 1; i < 200; ++i) {  // both go on; the new one is heard only now and then
    const Instant now = at_s(1.1 + 0.1 * i);
    EXPECT_EQ(offer_in(7, now, i, i % 2 == 0 ? kAnyRun : kNone), PlanFate::other_session) << i;
    if (i % 90 == 0) {
      EXPECT_EQ(offer_in(8, now, i, kAnyRun), PlanFate::accepted);
    }
  }
}

TEST_F(PlanOrderTest, UnknownSendersDoNotMakeTheSessionsOwnPlansLookOld) {
  ASSERT_EQ(offer_in(7, at_s(1), 0, kAnyRun), PlanFate::accepted);
  ASSERT_EQ(offer_in(8, at_s(1.1), 0, kAnyRun), PlanFate::accepted);
  Plan ahead = plan(at_s(2), 1'000'000);  // session 7, its clock half a second ahead
  EXPECT_EQ(offer(at_s(1.5), ahead), PlanFate::other_session);
  EXPECT_EQ(offer_in(8, at_s(1.6), 1, kAnyRun), PlanFate::accepted);
}

TEST_F(PlanOrderTest, ASessionOfOneDamagedPacketExcludesNoControllerForEver) {
  ASSERT_EQ(offer_in(7, at_s(1), 0, kAnyRun), PlanFate::accepted);
  ASSERT_EQ(offer_in(7 ^ 4096, at_s(1.5), 1, kAnyRun), PlanFate::accepted);
  const Instant back = at_s(1.5) + PlanBuffer::kSessionSilence;
  EXPECT_EQ(offer_in(7, back - kOrderTick, 2, kAnyRun), PlanFate::other_session);
  EXPECT_EQ(offer_in(7, back, 3, kAnyRun), PlanFate::accepted);
}

TEST_F(PlanOrderTest, EndlesslyManySessionsTakeBoundedMemory) {
  for (int i = 0; i < 10'000; ++i) {
    ASSERT_EQ(offer_in(i, at_s(1.0 + 0.001 * i), i, kAnyRun), PlanFate::accepted);
  }
  CounterList list;
  buffer.list(list);
  EXPECT_EQ(list.back().second, 10'000);
}

/// A controller that does what plan_t asks: it bases its plans on what the newest pose says, on
/// NONE where that is not its own.
struct Controller {
  std::int64_t session;
  std::int64_t next = 0;
  std::optional<PlanName> reported;

  Plan decide(Instant now) {
    const bool own = reported && reported->session == session;
    Plan p = plan(now, next++, own ? reported->id : kNone);
    p.name.session = session;
    return p;
  }
};

// Poses and plans are lost and late at random, the horizon runs out again and again, controllers
// restart. As soon as the network is good, the next round trip brings a plan.
TEST(PlanRecovery, AConsistentControllerAlwaysComesBack) {
  std::mt19937 random(5);
  for (int trial = 0; trial < 300; ++trial) {
    PlanBuffer buffer{StopLimits{}, StreamGuard::Config{}};
    Controller controller{trial, 0, {}};
    struct Flight {
      Instant arrival;
      Plan plan;
    };
    std::vector<Flight> flying;
    Instant now = at_s(1);
    const auto deliver = [&] {
      for (auto it = flying.begin(); it != flying.end();) {
        if (it->arrival > now) {
          ++it;
          continue;
        }
        buffer.offer(now, PlanSource::network, it->plan);
        it = flying.erase(it);
      }
    };
    for (int step = 0; step < 100; ++step, now += std::chrono::milliseconds{100}) {
      if (random() % 100 == 0) controller = Controller{1000 + trial * 100 + step, 0, {}};
      if (random() % 3 == 0) controller.reported = buffer.newest();
      Plan p = controller.decide(now);
      if (random() % 2 == 0) p.start += std::chrono::milliseconds{random() % 300};
      if (random() % 3 == 0) flying.push_back({now + std::chrono::milliseconds{random() % 900}, p});
      deliver();
    }
    flying.clear();
    now += std::chrono::seconds{1};  // all that waited has taken over
    controller.reported = buffer.newest();
    const Plan p = controller.decide(now);
    EXPECT_EQ(buffer.offer(now, PlanSource::network, p), PlanFate::accepted) << trial;
  }
}

}  // namespace
}  // namespace tether
