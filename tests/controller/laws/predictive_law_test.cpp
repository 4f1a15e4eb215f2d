#include "controller/laws/predictive_law.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <utility>

#include "common/vehicle/actuator.hpp"
#include "controller/laws/controller_settings.hpp"
#include "tests/controller/laws/laws_rig.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::at_ms;
using test::at_s;
using test::LawRig;
using test::with_law;

Plan plan_of(const LawOutput& output) { return std::get<Plan>(output); }

/// The model as the vehicle behind a PlanBuffer; poses at each second, decisions at `rate_hz`.
struct PlanRig : LawRig {
  PlanBuffer buffer{{}, {}};
  std::int64_t seq = 0;
  std::optional<SeenPose> newest;
  bool takes_extensions = true;

  explicit PlanRig(const Scenario& s) : LawRig(s) {}

  PlanFate offer(Instant now, Plan plan) {
    plan.name.session = 7;
    plan.stamp = now;
    plan.seq = seq++;
    return buffer.offer(now, PlanSource::network, std::move(plan));
  }
  void see(Instant t) {
    const PlanName name = buffer.newest();
    newest = seen(t, Duration{0}, name.id < 0 ? std::nullopt : std::optional(name.id));
    law->on_pose(*newest);
  }
  void move(Instant from, Instant to) {
    drive(from, to, [this](Instant t) { return buffer.in_force(t).value_or(Twist{}); });
  }
  /// The mean error of a run; `pose_lost` and `plan_lost` say so for the n-th.
  double run(Duration period, const std::function<bool(int)>& pose_lost,
             const std::function<bool(int)>& plan_lost, Instant end = at_s(62)) {
    double sum = 0.0;
    int n = 0, poses = 0, plans = 0;
    for (Instant t = kStart; t < end; t += period) {
      if ((t - kStart) % seconds{1} == Duration{0} && !pose_lost(poses++)) see(t);
      Plan plan = plan_of(law->decide(t, newest ? &*newest : nullptr));
      const bool ordinary = plan.based_on == plan.based_on_last;
      const bool lost = plan_lost(plans++);
      if (!lost && (takes_extensions || ordinary)) offer(t, std::move(plan));
      sum += error_m(t);
      ++n;
      move(t, t + period);
    }
    return sum / n;
  }
};

/// Packets of one direction, lost at random.
std::function<bool(int)> lost_at_random(unsigned seed, double prr) {
  return [random = std::mt19937(seed), prr](int) mutable {
    return std::uniform_real_distribution<double>(0.0, 1.0)(random) >= prr;
  };
}

bool never(int) { return false; }
bool most(int n) { return n % 7 != 3; }

TEST(PredictiveLaw, PlansTheHorizonInItsSteps) {
  Scenario s = with_law("predictive");
  s.get<ControllerSettings>().horizon_s = 5.0;
  s.get<ControllerSettings>().plan_step_ms = 25.0;
  LawRig rig(s);
  const Plan plan = plan_of(rig.law->decide(kStart, nullptr));
  EXPECT_EQ(plan.twists.size(), 200U);
  EXPECT_EQ(plan.step, milliseconds{25});
  EXPECT_EQ(plan.start, kStart);
  EXPECT_EQ(plan.name.id, 0);
  EXPECT_EQ(plan.based_on, Plan::kBasedOnAny);
}

TEST(PredictiveLaw, AVehicleThatFollowsThePlanIsOnThePathSoonAndStays) {
  PlanRig rig(with_law("predictive_consistent"));
  ASSERT_EQ(rig.offer(kStart, plan_of(rig.law->decide(kStart, nullptr))), PlanFate::accepted);
  rig.move(kStart, at_s(4));
  for (int t = 4; t < 20; ++t) {
    EXPECT_LT(rig.error_m(at_s(t)), 0.01) << t << " s";
    rig.move(at_s(t), at_s(t + 1));
  }
}

TEST(PredictiveLaw, NoStepAsksForMoreThanTheWheelsCanDo) {
  LawRig rig(with_law("predictive"));
  rig.vehicle.pose = {5.0, -3.0, 2.0};  // far off, and turned away
  const SeenPose seen = rig.seen(at_s(1));
  rig.law->on_pose(seen);
  const Plan plan = plan_of(rig.law->decide(at_s(1), &seen));
  WheelSpeeds before;
  for (const Twist& twist : plan.twists) {
    const WheelSpeeds rim = rig.model.rim_of(twist);
    const double most_mps = 3.0 * 0.05 + 1e-9;
    EXPECT_LE(std::abs(rim.left_mps - before.left_mps), most_mps);
    EXPECT_LE(std::abs(rim.right_mps - before.right_mps), most_mps);
    before = rim;
  }
}

TEST(PredictiveLaw, ConsistentPlansSayWhatTheyWerePredictedFrom) {
  LawRig rig(with_law("predictive_consistent"));
  EXPECT_EQ(plan_of(rig.law->decide(kStart, nullptr)).based_on, Plan::kBasedOnNone);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(500), nullptr)).based_on, Plan::kBasedOnNone);
  const SeenPose seen = rig.seen(at_s(1), Duration{0}, 1);
  rig.law->on_pose(seen);
  const Plan plan = plan_of(rig.law->decide(at_s(1), &seen));
  EXPECT_EQ(plan.name.id, 2);
  EXPECT_EQ(plan.based_on, 1);
}

TEST(PredictiveLaw, PlansBeginWhenTheyShouldArrive) {
  LawRig rig(with_law("predictive"));
  const SeenPose seen = rig.seen(at_s(1), milliseconds{120});
  rig.law->on_pose(seen);
  EXPECT_EQ(plan_of(rig.law->decide(seen.arrival, &seen)).start, seen.arrival + milliseconds{120});
}

TEST(PredictiveLaw, OfPlansFromOnePoseTheVehicleFollowsTheFirst) {
  PlanRig rig(with_law("predictive_consistent"));
  rig.see(kStart);
  EXPECT_EQ(rig.offer(kStart, plan_of(rig.law->decide(kStart, &*rig.newest))), PlanFate::accepted);
  rig.move(kStart, at_ms(100));
  EXPECT_EQ(rig.offer(at_ms(100), plan_of(rig.law->decide(at_ms(100), &*rig.newest))),
            PlanFate::inconsistent);
}

TEST(PredictiveLaw, HeavyLossCostsNothingOnceThePlanIsOnBoard) {
  Scenario s = with_law("predictive_consistent");
  PlanRig perfect(s), lossy(s);
  const double without = perfect.run(milliseconds{100}, never, never);
  // The first plan to arrive is the one of 0.3 s.
  const double with = lossy.run(milliseconds{100}, most, most);
  EXPECT_LT(without, 0.031);
  EXPECT_LT(with, 0.070);
}

TEST(PredictiveLaw, ThePlainFormSuffersWhereTheConsistentOneDoesNot) {
  const auto lost_at_first = [](int n) { return n < 20; };
  PlanRig plain(with_law("predictive"));
  PlanRig consistent(with_law("predictive_consistent"));
  // Poses are lost, too: no pose shows that the vehicle still stands.
  const double p = plain.run(
      milliseconds{100}, [](int n) { return n > 0 && n < 8; }, lost_at_first);
  const double c = consistent.run(
      milliseconds{100}, [](int n) { return n > 0 && n < 8; }, lost_at_first);
  EXPECT_GT(p, 1.5 * c);
}

TEST(PredictiveLaw, WithAPreloadedPlanNothingNeedsToArrive) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 62.0;
  PlanRig rig(s);
  const std::optional<Plan> preload = rig.law->preload();
  ASSERT_TRUE(preload.has_value());
  EXPECT_EQ(preload->start, kStart);
  rig.offer(kStart, *preload);
  EXPECT_EQ(plan_of(rig.law->decide(kStart, nullptr)).based_on, preload->name.id);
  const auto all = [](int) { return true; };
  EXPECT_LT(rig.run(milliseconds{100}, all, all), 0.031);
}

TEST(PredictiveLaw, BehindTheHorizonItCountsOnTheVehiclesStop) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 2.0;
  PlanRig rig(s);
  rig.offer(kStart, plan_of(rig.law->decide(kStart, nullptr)));
  rig.move(kStart, at_s(6));
  SeenPose stale = rig.seen(at_s(0), Duration{0}, 0);
  stale.pose = {};
  rig.law->on_pose(stale);
  rig.law->decide(at_s(6), &stale);
  // It knows where the vehicle stopped: the error to the path is the true one.
  EXPECT_NEAR(rig.law->errors().distance_m, rig.error_m(at_s(6)), 0.05);
}

TEST(PredictiveLaw, AFirstPlanThatCameLateIsMendedBeforeThePoseThatShowsIt) {
  LawRig rig(with_law("predictive_consistent"));
  for (int i = 0; i < 5; ++i) rig.law->decide(at_ms(100.0 * i), nullptr);
  const SeenPose seen = rig.seen(kStart, milliseconds{500});
  rig.law->on_pose(seen);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(500), &seen)).based_on, 0);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(600), &seen)).based_on, Plan::kBasedOnNone);
}

TEST(PredictiveLaw, AVehicleThatFollowsAnUnknownSenderGetsAPlanThatMayTakeOver) {
  LawRig rig(with_law("predictive_consistent"));
  SeenPose seen = rig.seen(at_s(10));
  seen.follows_other = true;
  rig.law->on_pose(seen);
  const Plan plan = plan_of(rig.law->decide(at_s(10), &seen));
  EXPECT_EQ(plan.based_on, Plan::kBasedOnNone);
  EXPECT_GT(plan.twists.front().v_mps, 0.0);
}

TEST(PredictiveLaw, APlanSaysWhenItHasBroughtTheVehicleToThePath) {
  for (const double lag_m : {0.0, 2.0, 20.0}) {
    PlanRig rig(with_law("predictive_consistent"));
    rig.vehicle.pose.x_m -= lag_m;
    SeenPose seen = rig.seen(kStart);
    rig.law->on_pose(seen);
    const Plan plan = plan_of(rig.law->decide(kStart, &seen));
    ASSERT_LT(plan.settled, plan.end()) << lag_m;
    rig.offer(kStart, plan);
    rig.move(kStart, plan.settled - seconds{3});
    EXPECT_GT(rig.error_m(plan.settled - seconds{3}), 0.01) << lag_m;
    rig.move(plan.settled - seconds{3}, plan.settled);
    for (Instant t = plan.settled; t < plan.end() - seconds{1}; t += seconds{1}) {
      EXPECT_LT(rig.error_m(t), 0.005) << lag_m << " m, " << to_seconds(t) << " s";
      rig.move(t, t + seconds{1});
    }
  }
}

TEST(PredictiveLaw, APlanThatIsTooShortForThatNeverSettles) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 3.0;
  LawRig rig(s);
  const Plan plan = plan_of(rig.law->decide(kStart, nullptr));
  EXPECT_GT(plan.settled, plan.end());
}

/// Plan 0 of 20 s is followed from 0 s on, a pose of 5 s names it, and none comes any more.
struct SilenceRig : PlanRig {
  SilenceRig() : PlanRig(with_law("predictive_consistent")) {
    offer(kStart, plan_of(law->decide(kStart, nullptr)));
    move(kStart, at_s(5));
    see(at_s(5));
  }
  std::pair<std::int64_t, std::int64_t> base_of_plan_at(double t_s) {
    const Plan plan = plan_of(law->decide(at_s(t_s), &*newest));
    EXPECT_EQ(plan.settled == plan.start, plan.based_on != plan.based_on_last);
    return {plan.based_on, plan.based_on_last};
  }
};

TEST(PredictiveLaw, ExtendsPlansWhenTheNewestPoseIsOlderThanHalfTheHorizon) {
  using Base = std::pair<std::int64_t, std::int64_t>;
  SilenceRig rig;
  EXPECT_EQ(rig.base_of_plan_at(14.9), Base(0, 0));
  EXPECT_EQ(rig.base_of_plan_at(15.0), Base(0, 0));
  EXPECT_EQ(rig.base_of_plan_at(15.1), Base(0, 2));
  EXPECT_EQ(rig.base_of_plan_at(15.2), Base(0, 3));
  EXPECT_EQ(rig.base_of_plan_at(20.1), Base(0, 0)) << "it is over";
  EXPECT_EQ(rig.base_of_plan_at(20.2), Base(1, 5));
  EXPECT_EQ(rig.base_of_plan_at(20.3), Base(0, 0));
}

TEST(PredictiveLaw, ThePlanNamedIsLeftOutIfThePoseSaysThatItLeadsElsewhere) {
  using Base = std::pair<std::int64_t, std::int64_t>;
  SilenceRig rig;
  EXPECT_EQ(rig.base_of_plan_at(14.5), Base(0, 0));  // settles at 16.5 s
  rig.newest->pose.x_m += 0.5;
  EXPECT_EQ(rig.base_of_plan_at(16.4), Base(0, 0)) << "nothing to extend";
  EXPECT_EQ(rig.base_of_plan_at(16.6), Base(1, 2));
  EXPECT_EQ(rig.base_of_plan_at(16.7), Base(0, 0));
}

TEST(PredictiveLaw, EveryOtherPlanIsForAVehicleThatReceivedNothingSince) {
  LawRig rig(with_law("predictive_consistent"));
  for (int i = 0; i < 100; ++i) rig.law->decide(at_ms(100.0 * i), nullptr);
  int ordinary = 0, extended = 0;
  for (int i = 101; i < 150; ++i) {
    const Plan plan = plan_of(rig.law->decide(at_ms(100.0 * i), nullptr));
    if (plan.based_on == Plan::kBasedOnNone) {
      ++ordinary;
      continue;
    }
    ++extended;
    EXPECT_EQ(plan.based_on, 0);
    EXPECT_EQ(plan.based_on_last, plan.name.id - 1);
  }
  EXPECT_NEAR(ordinary, extended, 1);
}

TEST(PredictiveLaw, SurvivesASilenceOfPosesOfFourHorizons) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 10.0;
  const auto from_20_s = [](int n) { return n > 20; };
  PlanRig extended(s), plain(s);
  plain.takes_extensions = false;
  const double with = extended.run(milliseconds{100}, from_20_s, lost_at_random(1, 0.5));
  const double without = plain.run(milliseconds{100}, from_20_s, lost_at_random(1, 0.5));
  EXPECT_LT(extended.error_m(at_s(62)), 0.01);
  EXPECT_LT(with, 0.1);
  EXPECT_GT(without, 5.0) << "it stands from 31 s on";
}

TEST(PredictiveLaw, NeedsNoPoseAtAllIfTheStartIsKnown) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 10.0;
  PlanRig rig(s);
  const auto all = [](int) { return true; };
  EXPECT_LT(rig.run(milliseconds{100}, all, lost_at_random(2, 0.5)), 0.1);
  EXPECT_LT(rig.error_m(at_s(62)), 0.01);
}

TEST(PredictiveLaw, WhateverIsLostAVehicleOnThePathStaysThereWhileItsPlanLasts) {
  Scenario s = with_law("predictive_consistent");
  s.get<ControllerSettings>().horizon_s = 10.0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    PlanRig rig(s);
    const auto pose_lost = lost_at_random(seed, 0.05), plan_lost = lost_at_random(100 + seed, 0.2);
    int poses = 0, plans = 0, near = 0;
    for (Instant t = kStart; t < at_s(62); t += milliseconds{100}) {
      if ((t - kStart) % seconds{1} == Duration{0} && !pose_lost(poses++)) rig.see(t);
      Plan plan = plan_of(rig.law->decide(t, rig.newest ? &*rig.newest : nullptr));
      if (!plan_lost(plans++)) rig.offer(t, std::move(plan));
      const auto end = rig.buffer.end(t);
      const double error_m = rig.error_m(t);
      const bool lasts = end && *end > t;
      EXPECT_TRUE(!lasts || near < 20 || error_m < 0.03)
          << error_m << " m, seed " << seed << ", " << to_seconds(t) << " s";
      near = lasts && (near >= 20 || error_m < 0.005) ? near + 1 : 0;
      rig.move(t, t + milliseconds{100});
    }
    EXPECT_GE(near, 20) << seed;
  }
}

TEST(PredictiveLaw, StopsByAPlanOfStandingStill) {
  LawRig rig(with_law("predictive_consistent"));
  const Plan plan = plan_of(rig.law->stop(at_s(3)));
  ASSERT_EQ(plan.twists.size(), 1U);
  EXPECT_EQ(plan.twists[0].v_mps, 0.0);
  EXPECT_EQ(plan.based_on, Plan::kBasedOnAny);
}

}  // namespace
}  // namespace tether
