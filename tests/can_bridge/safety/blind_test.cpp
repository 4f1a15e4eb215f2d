#include "can_bridge/safety/command_watch.hpp"
#include "tests/can_bridge/safety/random_limits.hpp"
#include "tests/can_bridge/safety/rig.hpp"
#include "tests/common/actuator/plan_rig.hpp"

// Driving on plans without a fresh pose: bounded in time and in distance, from the pose
// that the newest plan was made from, and always with room to stop.

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using test::kCycle;
using test::kDisarm;
using test::kStale;
using test::plan;

struct Blind : test::SafetyRig {
  std::int64_t id = 0;

  Blind() { restart(config()); }

  void restart(SafetyCore::Config config) {
    config.actuator.policy = "horizon";
    core = SafetyCore(config);
    cycle();
  }
  /// A plan of 20 s, made from a pose that is `age` old.
  Plan long_plan(Twist twist, Duration age = {}) {
    Plan p = plan(now, id++, Plan::kBasedOnAny, twist, 200);
    p.pose = now - age;
    return p;
  }
  void offer(const Plan& p) { core.on_plan(now, PlanSource::network, p); }
  void arm_with_plan() {
    offer(long_plan({}));
    request(DriveRequest::arm);
    for (int i = 0; i < 4 && cycle().state != BridgeState::armed; ++i) now += kCycle;
    ASSERT_EQ(last.state, BridgeState::armed) << last.reason;
  }
  /// Armed and at `twist`, by plans that are made from poses `age` old.
  void drive_plan(Twist twist, Duration age = {}) {
    arm_with_plan();
    for (int i = 0; i < 200; ++i) {
      now += kCycle;
      offer(long_plan(twist, age));
      cycle();
      drives.standstill = last.twist.v_mps == 0.0 && last.twist.omega_radps == 0.0;
    }
  }
  /// The way from now on, with `more` before each cycle, until the vehicle stands.
  template <class More>
  double way_until_rest(More more) {
    const double before = driven_m;
    const Instant end = now + seconds{60};
    do {
      now += kCycle;
      more();
      cycle();
    } while (now < end && (last.twist.v_mps != 0.0 || last.twist.omega_radps != 0.0));
    return driven_m - before;
  }
  std::int64_t count(const std::string& name) const {
    CounterList all;
    core.list(all);
    for (const auto& [key, value] : all) {
      if (key == name) return value;
    }
    return 0;
  }
};

TEST_F(Blind, WithPlansEveryCycleItGoesAsFastAsItCanStopIn1mAnd1s) {
  drive_plan({3.0, 0.0});
  // r = 0.18 s: 1.5 * (1 - 0.18) m/s and 1.5 * (sqrt(0.18^2 + 2/1.5) - 0.18) m/s; the smaller.
  EXPECT_NEAR(last.twist.v_mps, 1.23, 0.03);
  expect_reason(
      "slowed: the vehicle is unseen for 0.00 s and 0.00 m (can.max_blind_s = 1, "
      "can.max_blind_m = 1)");
}

TEST_F(Blind, WithBothLinksDeadItStopsWithinTheBudgetOfTheNewestPlan) {
  drive_plan({3.0, 0.5});
  const Instant seen = now;
  const double way = way_until_rest([] {});
  EXPECT_LE(to_seconds(now - seen), 1.0);
  EXPECT_LE(way, 1.0);
  EXPECT_GT(way, 0.3);
  while (last.state == BridgeState::armed) cycle_after(kCycle);
  EXPECT_NEAR(to_seconds(now - seen), 1.5, 0.03) << "max_blind_s, then the ladder of old commands";
  expect_reason("the vehicle was unseen for 15");
}

TEST_F(Blind, WithTheUplinkDeadPlansThatStillComeDoNotProlongIt) {
  drive_plan({1.0, 0.0});
  const Instant pose = now;
  const double way = way_until_rest([&] {
    Plan p = long_plan({1.0, 0.0});
    p.pose = pose;
    offer(p);
  });
  EXPECT_LE(to_seconds(now - pose), 1.0);
  EXPECT_LE(way, 1.0);
  EXPECT_GT(count("plan.accepted"), 0);
}

TEST_F(Blind, ThePosesAgeCountsAsDrivenBlind) {
  drive_plan({3.0, 0.0}, milliseconds{500});
  // 0.5 s are over: 1.5 * (0.5 - 0.18) m/s.
  EXPECT_NEAR(last.twist.v_mps, 0.48, 0.03);
}

TEST_F(Blind, ThePlansAgeCountsToo) {
  arm_with_plan();
  for (int i = 0; i < 200; ++i) {
    now += kCycle;
    Plan p = long_plan({3.0, 0.0});
    p.stamp = now - milliseconds{500};
    offer(p);
    cycle();
  }
  EXPECT_NEAR(last.twist.v_mps, 0.48, 0.03);
}

TEST_F(Blind, DistanceBoundsTheSpeedWhereTimeDoesNot) {
  SafetyCore::Config config = Blind::config();
  config.max_blind = seconds{10};
  restart(config);
  drive_plan({3.0, 0.0});
  // R = 0.28 s: the drives' deadline of 0.1 s comes on top.
  EXPECT_NEAR(last.twist.v_mps, 1.5 * (std::sqrt(0.28 * 0.28 + 2.0 / 1.5) - 0.28), 0.03);
  EXPECT_LE(way_until_rest([] {}), 1.0);
}

TEST_F(Blind, OnTheSpotOnlyTimeBounds) {
  drive_plan({0.0, 2.0});
  const Instant seen = now;
  EXPECT_NEAR(last.twist.omega_radps, 2.0, 0.01);
  way_until_rest([] {});
  EXPECT_LE(to_seconds(now - seen), 1.0);
}

TEST_F(Blind, TheCurveStaysTheCurveWhenTheBudgetSlows) {
  drive_plan({2.0, 0.5});
  EXPECT_LT(last.twist.v_mps, 1.3);
  EXPECT_NEAR(last.twist.omega_radps / last.twist.v_mps, 0.25, 1e-6);
}

TEST_F(Blind, ANewPlanFromAFreshPoseResumes) {
  drive_plan({1.0, 0.0});
  way_until_rest([] {});
  ASSERT_EQ(last.state, BridgeState::armed);
  for (int i = 0; i < 100; ++i) {
    now += kCycle;
    offer(long_plan({1.0, 0.0}));
    cycle();
  }
  EXPECT_NEAR(last.twist.v_mps, 1.0, 1e-9);
  EXPECT_EQ(last.reason, "");
}

TEST_F(Blind, PlansWithoutAPoseAreRefused) {
  drive_plan({1.0, 0.0});
  const PlanName before = core.plan();
  Plan p = long_plan({1.0, 0.0});
  p.pose.reset();
  offer(p);
  EXPECT_EQ(core.plan(), before);
  EXPECT_EQ(count("plan.without_pose"), 1);
}

TEST_F(Blind, AStopWithoutAPoseIsObeyedAtOnce) {
  drive_plan({1.0, 0.0});
  Plan stop = long_plan({});
  stop.pose.reset();
  offer(stop);
  const double before = last.twist.v_mps;
  cycle_after(kCycle);
  cycle_after(kCycle);
  EXPECT_LT(last.twist.v_mps, before);
  EXPECT_EQ(last.state, BridgeState::armed);
}

TEST_F(Blind, PlansFromAPoseOfTheFutureAreRefusedAsIfWithout) {
  arm_with_plan();
  const PlanName before = core.plan();
  offer(long_plan({1.0, 0.0}, -SafetyCore::kMaxAhead - Duration{1}));
  EXPECT_EQ(core.plan(), before);
  EXPECT_EQ(count("plan.without_pose"), 1);
  offer(long_plan({1.0, 0.0}, -SafetyCore::kMaxAhead));
  EXPECT_NE(core.plan(), before);
}

TEST_F(Blind, PlansFromAnOlderPoseThanTheLastAreRefused) {
  drive_plan({1.0, 0.0}, milliseconds{100});
  const PlanName before = core.plan();
  const std::int64_t refused = count("plan.older_pose");
  offer(long_plan({1.0, 0.0}, milliseconds{100} + Duration{1}));
  EXPECT_EQ(core.plan(), before);
  EXPECT_EQ(count("plan.older_pose"), refused + 1);
  offer(long_plan({1.0, 0.0}, milliseconds{100}));
  EXPECT_NE(core.plan(), before) << "two plans from one pose";
}

TEST_F(Blind, PlansAsOldAsTheBudgetAreRefused) {
  arm_with_plan();
  const PlanName before = core.plan();
  now += seconds{1};
  Plan p = long_plan({1.0, 0.0});
  p.stamp = now - seconds{1};
  offer(p);
  EXPECT_EQ(core.plan(), before);
  EXPECT_EQ(count("plan.blind"), 1);
  p.seq = p.name.id = id++;
  p.stamp = p.pose.emplace(now - seconds{1} + Duration{1});
  offer(p);
  EXPECT_NE(core.plan(), before);
}

TEST_F(Blind, ATwistFromAPoseAsOldAsTheBudgetIsRefused) {
  drive(1.0);
  for (int i = 0; i < 200; ++i) {
    now += kCycle;
    core.on_command(now, now, command_seq++, {1.0, 0.0}, kStart + seconds{100});
    cycle();
  }
  EXPECT_EQ(core.disarms(), 1);
  EXPECT_GT(count("command.blind"), 0);
  expect_reason("the newest command was");
}

TEST_F(Blind, APreloadAloneDoesNotArm) {
  core.on_plan(now, PlanSource::preload, long_plan({}));
  request(DriveRequest::arm);
  EXPECT_EQ(cycle().state, BridgeState::disarmed);
  expect_reason("the only plan is a preload");
}

TEST_F(Blind, WhileArmedAnUnknownSendersPlanIsRefusedAndDoesNotLockOut) {
  drive_plan({1.0, 0.0});
  Plan of_other_session = long_plan({2.5, 0.0});
  of_other_session.name.session = 999;
  offer(of_other_session);
  EXPECT_EQ(core.plan().session, 7);
  EXPECT_EQ(count("plan.other_session"), 1);
  offer(long_plan({}));
  EXPECT_EQ(core.plan().id, id - 1);
  way_until_rest([&] { offer(long_plan({})); });
  EXPECT_EQ(last.state, BridgeState::armed);
}

TEST_F(Blind, AFirstPlanMayNotBeginASessionWhileArmedByTwists) {
  drive(1.0);
  offer(long_plan({2.5, 0.0}));
  EXPECT_EQ(core.plan(), PlanName{});
  EXPECT_EQ(count("plan.other_session"), 1);
}

TEST_F(Blind, AStopOfAnySessionStopsAndDisarms) {
  drive_plan({1.0, 0.0});
  Plan stop = long_plan({});
  stop.name.session = 3;
  stop.based_on = stop.based_on_last = 4711;
  offer(stop);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::stopping);
  expect_reason("a controller of another session said to stand still");
  way_until_rest([&] { offer(long_plan({1.0, 0.0})); });
  drives.standstill = true;
  for (int i = 0; i < 5; ++i) cycle_after(kCycle);
  EXPECT_EQ(last.state, BridgeState::disarmed);
  EXPECT_EQ(count("plan.stop_of_other_session"), 1);
}

TEST_F(Blind, APlanWithoutTwistsIsNoStop) {
  drive_plan({1.0, 0.0});
  Plan empty = long_plan({});
  empty.name.session = 3;
  empty.twists.clear();
  offer(empty);
  EXPECT_EQ(cycle_after(kCycle).state, BridgeState::armed);
}

TEST_F(Blind, WhoTakesNoPlansStopsForNone) {
  core = SafetyCore(Blind::config());
  drives.phase = DrivePhase::standby;
  drive(1.0);
  offer(long_plan({}));
  keep_commanding(1, 1.0);
  EXPECT_EQ(last.state, BridgeState::armed);
}

TEST_F(Blind, ADisarmedVehicleChangesSessions) {
  arm_with_plan();
  request(DriveRequest::disarm);
  for (int i = 0; i < 5; ++i) cycle_after(kCycle);
  ASSERT_EQ(last.state, BridgeState::disarmed);
  Plan other = long_plan({});
  other.name.session = 8;
  offer(other);
  EXPECT_EQ(core.plan().session, 8);
}

/// The limits' own uncertainty: the budget holds whatever the accelerations and jerks are, whenever
/// the network dies, in bends and while speeding up.
TEST_F(Blind, TheBudgetHoldsForAnyLimitsAndAnyMoment) {
  test::Random random(2026);
  for (int run = 0; run < 300; ++run) {
    SafetyCore::Config config = Blind::config();
    config.limits = test::random_limits(random);
    config.limits.cycle = kCycle;
    config.max_blind = from_seconds(test::uniform(random, 0.4, 3.0));
    config.max_blind_m = test::uniform(random, 0.2, 3.0);
    drives.phase = DrivePhase::standby;
    drives.standstill = true;
    restart(config);
    arm_with_plan();
    const auto age_cycles = static_cast<std::size_t>(test::uniform(random, 0.0, 15.0));
    const Duration age = static_cast<int>(age_cycles) * kCycle;
    const Twist twist{test::uniform(random, -4.0, 4.0), test::uniform(random, -2.0, 2.0)};
    const int cycles = 1 + static_cast<int>(test::uniform(random, 0.0, 150.0));
    std::vector<double> driven(age_cycles + 1, driven_m);
    for (int i = 0; i < cycles; ++i) {
      now += kCycle;
      offer(long_plan(twist, age));
      cycle();
      driven.push_back(driven_m);
    }
    const Instant seen = now - age;
    const double before = driven[driven.size() - 2 - age_cycles];
    way_until_rest([] {});
    EXPECT_LE(to_seconds(now - seen), to_seconds(config.max_blind) + 1e-9) << run;
    EXPECT_LE(driven_m - before, config.max_blind_m + 1e-9) << run;
  }
}

/// How far and for how long a vehicle goes on whose drives stop it: each wheel goes on for
/// `reaction_s`, then brakes by itself.
struct DrivesStop {
  double way_m = 0.0;
  double time_s = 0.0;

  DrivesStop(const Twist& twist, double track_m, double reaction_s, double deceleration_mps2)
      : way_m(std::abs(twist.v_mps) * reaction_s), time_s(reaction_s) {
    constexpr double kStep_s = 1e-4;
    const double turning_mps = twist.omega_radps * track_m / 2.0;
    double left = twist.v_mps - turning_mps, right = twist.v_mps + turning_mps;
    const auto brake = [&](double& rim) {
      rim = std::copysign(std::max(0.0, std::abs(rim) - deceleration_mps2 * kStep_s), rim);
    };
    while (left != 0.0 || right != 0.0) {
      brake(left);
      brake(right);
      way_m += std::abs(left + right) / 2.0 * kStep_s;
      time_s += kStep_s;
    }
  }
};

/// Wheels that turn against each other do not slow the vehicle down while each brakes by itself.
TEST_F(Blind, AStopByTheDrivesKeepsToTheBudgetInAnyBendAndAtAnyMoment) {
  test::Random random(2027);
  for (int run = 0; run < 1000; ++run) {
    SafetyCore::Config config = Blind::config();
    config.limits = test::random_limits(random);
    config.limits.cycle = kCycle;
    config.max_blind = from_seconds(test::uniform(random, 0.4, 10.0));
    config.max_blind_m = test::uniform(random, 0.1, 1.0);
    const double required_mps2 = config.limits.max_deceleration_mps2;
    if (run % 3 != 0) config.drives_stop.mps2 = required_mps2 * test::uniform(random, 1.0, 3.0);
    const double deadline_s = test::uniform(random, 0.02, 0.3);
    config.drives_stop.deadline = from_seconds(deadline_s);
    drives.phase = DrivePhase::standby;
    drives.standstill = true;
    restart(config);
    arm_with_plan();
    const Twist twist{test::uniform(random, -2.0, 2.0), test::uniform(random, -3.0, 3.0)};
    const int seen_cycles = 1 + static_cast<int>(test::uniform(random, 0.0, 150.0));
    const int blind_cycles = static_cast<int>(test::uniform(random, 0.0, 100.0));
    double before = driven_m;
    for (int i = 0; i < seen_cycles; ++i) {
      now += kCycle;
      offer(long_plan(twist));
      before = driven_m;
      cycle();
    }
    const Instant seen = now;
    for (int i = 0; i < blind_cycles; ++i) cycle_after(kCycle);
    // Two cycles of drives and feedback.
    const DrivesStop stop(last.twist, config.limits.track_m, deadline_s + 2.0 * to_seconds(kCycle),
                          config.drives_stop.mps2.value_or(required_mps2));
    // driven_m goes one cycle ahead: `last.twist` is in force for that long.
    const double ahead_m = std::abs(last.twist.v_mps) * to_seconds(kCycle);
    EXPECT_LE(driven_m - ahead_m + stop.way_m - before, config.max_blind_m + 1e-9) << run;
    constexpr double kStands_mps = 0.02;
    const double turning_mps = std::abs(last.twist.omega_radps) * config.limits.track_m / 2.0;
    if (std::abs(last.twist.v_mps) + turning_mps < kStands_mps) continue;
    EXPECT_LE(to_seconds(now - seen) + stop.time_s,
              to_seconds(config.max_blind) + deadline_s + 1e-9)
        << run;
  }
}

/// The yaw rate falls more slowly than the budget, and wheels that turn against each other do not
/// slow the vehicle down when the bus dies, too.
TEST_F(Blind, UnseenInATurnItsWheelsCanAlwaysStopWithinTheBudget) {
  SafetyCore::Config config = Blind::config();
  config.max_blind = seconds{10};
  config.max_blind_m = 0.3;
  config.limits.max_yaw_acceleration_radps2 = config.limits.max_yaw_deceleration_radps2 = 0.4;
  restart(config);
  drive_plan({0.3, 2.0});
  ASSERT_GT(last.twist.omega_radps, 1.2);
  const double before = driven_m;
  for (int i = 0; i < 200; ++i) {
    cycle_after(kCycle);
    const DrivesStop stop(last.twist, config.limits.track_m, 0.1 + 2.0 * to_seconds(kCycle),
                          config.limits.max_deceleration_mps2);
    ASSERT_LE(driven_m - before + stop.way_m, config.max_blind_m) << i;
  }
}

/// With 2 m/s² the wheels bound gentle bends, too; with 4 m/s² there the ramp does.
TEST(BlindBudget, KnowsTheWayOfWheelsThatBrakeByThemselves) {
  for (const double wheels_mps2 : {2.0, 4.0}) {
    BlindBudget budget({.max_time = seconds{10},
                        .max_distance_m = 0.5,
                        .deceleration_mps2 = 2.0,
                        .yaw_deceleration_radps2 = 5.0,
                        .reaction = milliseconds{200},
                        .drives_reaction = milliseconds{300},
                        .wheel_deceleration_mps2 = wheels_mps2,
                        .half_track_m = 0.5});
    budget.update(kStart, 0.0, kStart);
    // Straight on: 0.3 v + v²/4 = 0.5 by the wheels, 0.2 v + v²/4 = 0.5 by the ramp.
    const double straight = wheels_mps2 < 3.0 ? 2.0 * (std::sqrt(0.09 + 0.5) - 0.3)
                                              : 2.0 * (std::sqrt(0.04 + 0.5) - 0.2);
    EXPECT_NEAR(budget.share({2.0, 0.0}) * 2.0, straight, 1e-12);
    EXPECT_NEAR(budget.speed_beside(0.0), straight, 1e-12);
    for (const Twist twist : {Twist{2.0, 0.8}, Twist{-2.0, 3.0}, Twist{2.0, 4.0}, Twist{2.0, -4.4},
                              Twist{-1.0, 6.0}, Twist{0.5, 8.0}}) {
      const double share = budget.share(twist);
      const Twist most{share * twist.v_mps, share * twist.omega_radps};
      ASSERT_LT(share, 1.0);
      const double by_drives = DrivesStop(most, 1.0, 0.3, wheels_mps2).way_m;
      const double by_ramp = 0.2 * std::abs(most.v_mps) + most.v_mps * most.v_mps / 4.0;
      EXPECT_NEAR(std::max(by_drives, by_ramp), 0.5, 1e-3)
          << wheels_mps2 << " " << twist.omega_radps;
      EXPECT_NEAR(budget.speed_beside(most.omega_radps), std::abs(most.v_mps), 1e-9)
          << wheels_mps2 << " " << twist.omega_radps;
    }
  }
}

TEST(BlindBudget, KnowsTheTimeOfWheelsThatBrakeByThemselves) {
  BlindBudget budget({.max_time = seconds{1},
                      .max_distance_m = 100.0,
                      .deceleration_mps2 = 3.0,
                      .yaw_deceleration_radps2 = 6.0,
                      .reaction = milliseconds{200},
                      .drives_reaction = milliseconds{400},
                      .wheel_deceleration_mps2 = 4.0,
                      .half_track_m = 0.5});
  budget.update(kStart, 0.0, kStart);
  // The faster rim, of |v| + 0.5·|ω|, has 0.8 s at 4 m/s².
  EXPECT_NEAR(budget.share({-2.0, 4.0}), 3.2 / 4.0, 1e-12);
  EXPECT_EQ(budget.share({1.2, 4.0}), 1.0);
  EXPECT_NEAR(budget.share({3.0, 0.0}), 2.4 / 3.0, 1e-12) << "the ramp is weaker straight on";
  EXPECT_NEAR(budget.share({0.0, 8.0}), 4.8 / 8.0, 1e-12) << "and on the spot";
}

}  // namespace
}  // namespace tether
