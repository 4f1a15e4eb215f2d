#include "common/vehicle/actuator_settings.hpp"
#include "tests/can_bridge/safety/rig.hpp"
#include "tests/common/vehicle/plan_rig.hpp"

// Plans in the CAN bridge: fresh while they last; from the end of the horizon on the ladder of old
// commands counts.

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using testing::kCycle;
using testing::kDisarm;
using testing::kStale;
using testing::plan;

struct SafetyPlan : testing::SafetyRig {
  std::int64_t id = 0;

  SafetyPlan() {
    SafetyCore::Config with_plans = config();
    with_plans.actuator.policy = "horizon";
    core = SafetyCore(with_plans);
    cycle();
  }
  void offer(Plan p) {
    p.stamp = now;
    core.on_plan(now, PlanSource::network, std::move(p));
  }
  /// Twists of 0.1 s each from now on.
  void offer(Twist twist, std::size_t count) {
    offer(plan(now, id++, Plan::kBasedOnAny, twist, count));
  }
  void arm_with_plan() {
    offer(Twist{}, 30);
    request(DriveRequest::arm);
    for (int i = 0; i < 4 && cycle().state != BridgeState::armed; ++i) now += kCycle;
    ASSERT_EQ(last.state, BridgeState::armed) << last.reason;
  }
  /// Armed, at `v_mps`; the end of the plan's horizon.
  Instant drive_plan(double v_mps) {
    arm_with_plan();
    offer({v_mps, 0.0}, 30);
    const Instant end = now + seconds{3};
    while (now < end - kCycle) cycle_after(kCycle);
    EXPECT_NEAR(last.twist.v_mps, v_mps, 1e-9);
    drives.standstill = false;
    return end;
  }
};

TEST_F(SafetyPlan, OnePlanIsFollowedToItsEndWithoutAnythingElse) {
  const Instant end = drive_plan(1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
  EXPECT_EQ(last.reason, "");
  EXPECT_EQ(core.command_age(end - Duration{1}), Duration{0});
  EXPECT_EQ(core.command_age(end), Duration{0});
  EXPECT_EQ(core.command_age(end + Duration{1}), Duration{1});
}

TEST_F(SafetyPlan, AfterItsEndItRampsAtOnceIsStaleAtStaleAndDisarmedAtDisarm) {
  const Instant end = drive_plan(1.0);
  now = end + kStale - Duration{1};
  EXPECT_EQ(cycle().reason, "") << "the plan's own ramp";
  now = end + kStale;
  cycle();
  expect_reason("the horizon of the plan in force is 200 ms past: ramping to zero");
  EXPECT_LT(last.twist.v_mps, 1.0);
  now = end + kDisarm - Duration{1};
  EXPECT_EQ(cycle().state, BridgeState::armed);
  now = end + kDisarm;
  EXPECT_EQ(cycle().action, Action::quick_stop);
  EXPECT_EQ(core.disarms(), 1);
  expect_reason("the horizon of the plan in force was 500 ms past");
}

TEST_F(SafetyPlan, ANewPlanInTimeResumes) {
  const Instant end = drive_plan(1.0);
  while (now < end + milliseconds{300}) cycle_after(kCycle);
  const double slow_mps = last.twist.v_mps;
  EXPECT_LT(slow_mps, 0.9);
  offer({1.0, 0.0}, 30);
  for (int i = 0; i < 50; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.reason, "");
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
}

TEST_F(SafetyPlan, RefusedPlansRefreshNothing) {
  const Instant end = drive_plan(1.0);
  while (now < end + kDisarm) {
    Plan expired = plan(now - seconds{1}, id++);
    offer(expired);
    offer(plan(now, id++, 999));  // inconsistent
    Plan broken = plan(now, id++);
    broken.step = Duration{0};
    offer(broken);
    cycle_after(kCycle);
  }
  EXPECT_EQ(core.disarms(), 1);
}

TEST_F(SafetyPlan, ArmingNeedsAPlanThatSaysZeroNow) {
  offer({0.5, 0.0}, 30);
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("the newest command is not zero (0.500 m/s, 0.000 rad/s)");
}

TEST_F(SafetyPlan, APlanThatIsOverDoesNotArm) {
  offer(Twist{}, 1);
  now += milliseconds{100} + kStale;
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("the horizon of the plan in force is 200 ms past (limit 200 ms)");
}

TEST_F(SafetyPlan, AFirstPlanThatWaitsForItsStartArmsAndThenMoves) {
  offer(plan(now + seconds{2}, id++, Plan::kBasedOnNone, {1.0, 0.0}, 30));
  request(DriveRequest::arm);
  const Instant start = now + seconds{2};
  while (now < start - kCycle) {
    cycle_after(kCycle);
    EXPECT_EQ(last.twist.v_mps, 0.0);
  }
  EXPECT_EQ(last.state, BridgeState::armed) << last.reason;
  for (int i = 0; i < 100; ++i) cycle_after(kCycle);
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
}

TEST_F(SafetyPlan, ATwistTakesOverAndAgesAsTwistsDo) {
  drive_plan(1.0);
  command(0.5);
  EXPECT_EQ(core.plan(), PlanName{});
  EXPECT_EQ(core.command_age(now + milliseconds{30}), milliseconds{30});
  now += kDisarm;
  EXPECT_EQ(cycle().action, Action::quick_stop);
}

TEST_F(SafetyPlan, ADisarmedVehicleDoesNotFollowPlans) {
  for (int i = 0; i < 100; ++i) {
    offer({1.0, 0.5}, 30);
    cycle_after(kCycle);
    expect_no_motion();
  }
  EXPECT_EQ(core.plan().id, id - 1) << "but it keeps the books";
}

}  // namespace
}  // namespace tether
