#include "common/vehicle/actuator_settings.hpp"
#include "tests/can_bridge/safety/rig.hpp"
#include "tests/common/actuator/plan_rig.hpp"

// Plans in the CAN bridge: fresh while they last; from the end of the horizon on the ladder of old
// commands counts.

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::kCycle;
using test::kDisarm;
using test::kStale;
using test::plan;

struct SafetyPlan : test::SafetyRig {
  std::int64_t id = 0;

  SafetyPlan() {
    SafetyCore::Config with_plans = config();
    with_plans.actuator.policy = "horizon";
    with_plans.max_blind = seconds{10};  // the budget has tests of its own
    with_plans.max_blind_m = 100.0;
    core = SafetyCore(with_plans);
    cycle();
  }
  void offer(Plan p) {
    p.stamp = now;
    p.pose = now;
    core.on_plan(now, PlanSource::network, std::move(p));
  }
  /// Twists of 0.1 s each from now on.
  void offer(Twist twist, std::size_t count) {
    offer(plan(now, id++, Plan::kBasedOnAny, twist, count));
  }
  void cycle_until(Instant end) {
    while (now + kCycle < end) cycle_after(kCycle);
    now = end;
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

TEST_F(SafetyPlan, TheRampAfterAPlanThatMovesIsNoCommandToStandStill) {
  offer({0.05, 0.0}, 1);
  cycle_until(now + milliseconds{200});
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  EXPECT_EQ(core.command_age(now), milliseconds{100}) << "not yet stale";
  expect_reason("arming refused: the horizon of the plan in force is 100 ms past");
}

TEST_F(SafetyPlan, AZeroPlanArmsUntilItsHorizonEndsAndNotAfterIt) {
  const Instant end = now + milliseconds{100};
  offer(Twist{}, 1);
  cycle_until(end + Duration{1});
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  offer(Twist{}, 1);
  cycle_until(now + milliseconds{100});
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::arming) << last.reason;
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

TEST_F(SafetyPlan, ATwistThatMovesDoesNotTakeOverWhileArmed) {
  drive_plan(1.0);
  const PlanName before = core.plan();
  command(0.5);
  EXPECT_EQ(core.plan(), before);
  CounterList counters;
  core.list(counters);
  EXPECT_TRUE(std::find(counters.begin(), counters.end(),
                        std::pair<std::string, std::int64_t>("command.against_plan", 1)) !=
              counters.end());
}

TEST_F(SafetyPlan, ADisarmOfADisarmedVehicleEndsPlansToo) {
  offer(Twist{}, 300);
  request(DriveRequest::disarm);
  cycle();
  EXPECT_EQ(core.plan(), PlanName{});
}

TEST_F(SafetyPlan, ATwistThatStandsTakesOverAndAgesAsTwistsDo) {
  drive_plan(1.0);
  command(0.0);
  EXPECT_EQ(core.plan(), PlanName{});
  EXPECT_EQ(core.command_age(now + milliseconds{30}), milliseconds{30});
  now += kDisarm;
  EXPECT_EQ(cycle().action, Action::quick_stop);
}

/// Common result of all causes of a stop: the plan from before drives no more, and does not arm.
void expect_that_the_plan_is_over(SafetyPlan& rig) {
  Plan old = plan(rig.now, 1000, Plan::kBasedOnAny, Twist{}, 300);
  old.stamp = rig.now - Duration{1};
  for (int i = 0; i < 100 && rig.last.state != BridgeState::disarmed; ++i) {
    rig.drives.standstill = true;
    rig.request(DriveRequest::estop_release);
    rig.request(DriveRequest::reset);
    rig.cycle_after(kCycle);
    if (rig.drives.phase == DrivePhase::starting) rig.drives.phase = DrivePhase::standby;
  }
  ASSERT_EQ(rig.last.state, BridgeState::disarmed) << rig.last.reason;
  EXPECT_EQ(rig.core.plan(), PlanName{});
  rig.now += kCycle;
  old.start = rig.now;
  rig.core.on_plan(rig.now, PlanSource::network, old);  // was on its way
  rig.request(DriveRequest::arm);
  EXPECT_EQ(rig.cycle().state, BridgeState::disarmed);
  rig.expect_reason("there is no command yet");
  rig.arm_with_plan();
}

TEST_F(SafetyPlan, AnEStopEndsThePlanForGood) {
  drive_plan(1.0);
  request(DriveRequest::estop);
  cycle();
  expect_that_the_plan_is_over(*this);
}

TEST_F(SafetyPlan, AFaultEndsThePlanForGood) {
  drive_plan(1.0);
  bus = CanState::down;
  cycle();
  ASSERT_EQ(last.action, Action::quick_stop);
  bus = CanState::up;
  expect_that_the_plan_is_over(*this);
}

TEST_F(SafetyPlan, ADisarmEndsThePlanForGood) {
  drive_plan(1.0);
  request(DriveRequest::disarm);
  cycle();
  expect_that_the_plan_is_over(*this);
}

TEST_F(SafetyPlan, AQuickStopEndsThePlanForGood) {
  const Instant end = drive_plan(1.0);
  offer(plan(end + seconds{20}, id++, Plan::kBasedOnAny, {1.0, 0.0}, 30));  // waits
  cycle_until(end + kDisarm);
  ASSERT_EQ(cycle().action, Action::quick_stop);
  expect_that_the_plan_is_over(*this);
}

TEST_F(SafetyPlan, APlanOfBeforeTheResetDoesNotArm) {
  drive_plan(1.0);
  request(DriveRequest::estop);
  for (int i = 0; i < 10; ++i) cycle_after(kCycle), drives.standstill = true;
  ASSERT_EQ(last.state, BridgeState::estop);
  offer(Twist{}, 300);
  expect_that_the_plan_is_over(*this);
}

TEST_F(SafetyPlan, ThePlanOfASilentControllerDoesNotArm) {
  offer(Twist{}, 300);
  cycle_until(now + SafetyCore::kPlanSilence);
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("the newest plan is 1000 ms old (limit 1000 ms): is the controller alive?");
  offer(Twist{}, 300);
  cycle_until(now + SafetyCore::kPlanSilence - Duration{1});
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::arming);
}

TEST_F(SafetyPlan, ForArmingAPlanIsAsOldAsItsStampOrItsArrivalWhicheverIsEarlier) {
  for (const Duration ahead : {-milliseconds{400}, milliseconds{50}}) {
    Plan next = plan(now, id++, Plan::kBasedOnAny, Twist{}, 300);
    next.stamp = now + ahead;
    core.on_plan(now, PlanSource::network, next);
    cycle_until(now + SafetyCore::kPlanSilence + std::min(ahead, Duration{0}));
    request(DriveRequest::arm);
    EXPECT_EQ(cycle().state, BridgeState::disarmed);
    expect_reason("the newest plan is 1000 ms old");
  }
}

TEST_F(SafetyPlan, AControllerThatFallsSilentWhileTheDrivesSwitchOnDoesNotArm) {
  offer(Twist{}, 300);
  cycle_until(now + SafetyCore::kPlanSilence - Duration{1});
  request(DriveRequest::arm);
  cycle();
  for (int i = 0; i < 4; ++i) cycle_after(kCycle), expect_no_motion();
  EXPECT_EQ(last.state, BridgeState::disarmed);
  expect_reason("is the controller alive?: arm again");
}

TEST_F(SafetyPlan, AnOldPreloadDoesNotArm) {
  Plan preload = plan(now + seconds{60}, id++, Plan::kBasedOnNone, {1.0, 0.0}, 30);
  preload.stamp = now;
  core.on_plan(now, PlanSource::preload, preload);
  cycle_until(now + seconds{59});
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("the only plan is a preload");
}

TEST_F(SafetyPlan, PreloadsAreRefusedWhileArmed) {
  drive_plan(1.0);
  const PlanName before = core.plan();
  Plan preload = plan(now, id++, Plan::kBasedOnAny, {2.0, 0.0}, 30);
  preload.stamp = now;
  core.on_plan(now, PlanSource::preload, preload);
  EXPECT_EQ(core.plan(), before);
  CounterList counters;
  core.list(counters);
  EXPECT_TRUE(std::any_of(counters.begin(), counters.end(), [](const auto& counter) {
    return counter.first == "plan.preload_while_armed" && counter.second == 1;
  }));
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
