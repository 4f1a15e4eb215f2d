#include "controller/predictive_law.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "common/plan_buffer.hpp"
#include "tests/laws_rig.hpp"
#include "tests/virtual_world.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::at_ms;
using testing::at_s;
using testing::LawRig;
using testing::with_law;

Plan plan_of(const LawOutput& output) { return std::get<Plan>(output); }

/// The model as the vehicle behind a PlanBuffer; poses at each second, decisions at `rate_hz`.
struct PlanRig : LawRig {
  PlanBuffer buffer{{}, {}};
  std::int64_t seq = 0;
  std::optional<SeenPose> newest;

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
      if (!plan_lost(plans++)) offer(t, std::move(plan));
      sum += error_m(t);
      ++n;
      move(t, t + period);
    }
    return sum / n;
  }
};

bool never(int) { return false; }
bool most(int n) { return n % 7 != 3; }

TEST(PredictiveLaw, PlansTheHorizonInItsSteps) {
  Scenario s = with_law(ControlLaw::predictive);
  s.controller.horizon_s = 5.0;
  s.controller.plan_step_ms = 25.0;
  LawRig rig(s);
  const Plan plan = plan_of(rig.law->decide(kStart, nullptr));
  EXPECT_EQ(plan.twists.size(), 200U);
  EXPECT_EQ(plan.step, milliseconds{25});
  EXPECT_EQ(plan.start, kStart);
  EXPECT_EQ(plan.name.id, 0);
  EXPECT_EQ(plan.based_on, Plan::kBasedOnAny);
}

TEST(PredictiveLaw, AVehicleThatFollowsThePlanIsOnThePathSoonAndStays) {
  PlanRig rig(with_law(ControlLaw::predictive_consistent));
  ASSERT_EQ(rig.offer(kStart, plan_of(rig.law->decide(kStart, nullptr))), PlanFate::accepted);
  rig.move(kStart, at_s(4));
  for (int t = 4; t < 20; ++t) {
    EXPECT_LT(rig.error_m(at_s(t)), 0.01) << t << " s";
    rig.move(at_s(t), at_s(t + 1));
  }
}

TEST(PredictiveLaw, NoStepAsksForMoreThanTheWheelsCanDo) {
  LawRig rig(with_law(ControlLaw::predictive));
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
  LawRig rig(with_law(ControlLaw::predictive_consistent));
  EXPECT_EQ(plan_of(rig.law->decide(kStart, nullptr)).based_on, Plan::kBasedOnNone);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(500), nullptr)).based_on, Plan::kBasedOnNone);
  const SeenPose seen = rig.seen(at_s(1), Duration{0}, 1);
  rig.law->on_pose(seen);
  const Plan plan = plan_of(rig.law->decide(at_s(1), &seen));
  EXPECT_EQ(plan.name.id, 2);
  EXPECT_EQ(plan.based_on, 1);
}

TEST(PredictiveLaw, PlansBeginWhenTheyShouldArrive) {
  LawRig rig(with_law(ControlLaw::predictive));
  const SeenPose seen = rig.seen(at_s(1), milliseconds{120});
  rig.law->on_pose(seen);
  EXPECT_EQ(plan_of(rig.law->decide(seen.arrival, &seen)).start, seen.arrival + milliseconds{120});
}

TEST(PredictiveLaw, OfPlansFromOnePoseTheVehicleFollowsTheFirst) {
  PlanRig rig(with_law(ControlLaw::predictive_consistent));
  rig.see(kStart);
  EXPECT_EQ(rig.offer(kStart, plan_of(rig.law->decide(kStart, &*rig.newest))), PlanFate::accepted);
  rig.move(kStart, at_ms(100));
  EXPECT_EQ(rig.offer(at_ms(100), plan_of(rig.law->decide(at_ms(100), &*rig.newest))),
            PlanFate::inconsistent);
}

TEST(PredictiveLaw, HeavyLossCostsNothingOnceThePlanIsOnBoard) {
  Scenario s = with_law(ControlLaw::predictive_consistent);
  PlanRig perfect(s), lossy(s);
  const double without = perfect.run(milliseconds{100}, never, never);
  // The first plan to arrive is the one of 0.3 s.
  const double with = lossy.run(milliseconds{100}, most, most);
  EXPECT_LT(without, 0.031);
  EXPECT_LT(with, 0.070);
}

TEST(PredictiveLaw, ThePlainFormSuffersWhereTheConsistentOneDoesNot) {
  const auto lost_at_first = [](int n) { return n < 20; };
  PlanRig plain(with_law(ControlLaw::predictive));
  PlanRig consistent(with_law(ControlLaw::predictive_consistent));
  // Poses are lost, too: nobody tells that the vehicle still stands.
  const double p = plain.run(
      milliseconds{100}, [](int n) { return n > 0 && n < 8; }, lost_at_first);
  const double c = consistent.run(
      milliseconds{100}, [](int n) { return n > 0 && n < 8; }, lost_at_first);
  EXPECT_GT(p, 1.5 * c);
}

TEST(PredictiveLaw, WithAPreloadedPlanNothingNeedsToArrive) {
  Scenario s = with_law(ControlLaw::predictive_consistent);
  s.controller.horizon_s = 62.0;
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
  Scenario s = with_law(ControlLaw::predictive_consistent);
  s.controller.horizon_s = 2.0;
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
  LawRig rig(with_law(ControlLaw::predictive_consistent));
  for (int i = 0; i < 5; ++i) rig.law->decide(at_ms(100.0 * i), nullptr);
  const SeenPose seen = rig.seen(kStart, milliseconds{500});
  rig.law->on_pose(seen);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(500), &seen)).based_on, 0);
  EXPECT_EQ(plan_of(rig.law->decide(at_ms(600), &seen)).based_on, Plan::kBasedOnNone);
}

TEST(PredictiveLaw, AVehicleThatFollowsAStrangerGetsAPlanThatMayTakeOver) {
  LawRig rig(with_law(ControlLaw::predictive_consistent));
  SeenPose seen = rig.seen(at_s(10));
  seen.follows_other = true;
  rig.law->on_pose(seen);
  const Plan plan = plan_of(rig.law->decide(at_s(10), &seen));
  EXPECT_EQ(plan.based_on, Plan::kBasedOnNone);
  EXPECT_GT(plan.twists.front().v_mps, 0.0);
}

TEST(PredictiveLaw, StopsByAPlanOfStandingStill) {
  LawRig rig(with_law(ControlLaw::predictive_consistent));
  const Plan plan = plan_of(rig.law->stop(at_s(3)));
  ASSERT_EQ(plan.twists.size(), 1U);
  EXPECT_EQ(plan.twists[0].v_mps, 0.0);
  EXPECT_EQ(plan.based_on, Plan::kBasedOnAny);
}

}  // namespace
}  // namespace tether
