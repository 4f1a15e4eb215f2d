#include "common/vehicle/actuator.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>

#include "common/scenario/scenario.hpp"
#include "common/vehicle/actuator_policy.hpp"
#include "tests/common/actuator/plan_rig.hpp"
#include "tests/support/table_rows.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::plan;
constexpr Duration kTick{1};

ActuatorSettings config(const std::string& policy) {
  ActuatorSettings config;
  config.policy = policy;
  config.timeout_s = 0.5;
  config.decay_s = 0.25;
  config.deceleration_mps2 = 2.0;
  config.yaw_deceleration_radps2 = 4.0;
  return config;
}

Actuator actuator(const std::string& policy) { return Actuator(config(policy), {}, {}); }

void expect_twist(const Twist& twist, double v_mps, double omega_radps) {
  EXPECT_NEAR(twist.v_mps, v_mps, 1e-12);
  EXPECT_NEAR(twist.omega_radps, omega_radps, 1e-12);
}

class EachPolicy : public ::testing::TestWithParam<std::string> {};

TEST_P(EachPolicy, StandsStillBeforeTheFirstCommand) {
  for (const double t_s : {-10.0, 0.0, 3.0}) {
    expect_twist(actuator(GetParam()).in_force(at_s(t_s)), 0.0, 0.0);
  }
}

TEST_P(EachPolicy, FollowsACommandFromItsArrivalToATickBeforeTheTimeout) {
  Actuator a = actuator(GetParam());
  a.on_command(at_s(1), {1.0, 0.2});
  expect_twist(a.in_force(at_s(1)), 1.0, 0.2);
  expect_twist(a.in_force(at_s(1.5) - kTick), 1.0, 0.2);
}

TEST_P(EachPolicy, ANewCommandRestartsTheTimeout) {
  Actuator a = actuator(GetParam());
  a.on_command(at_s(1), {1.0, 0.0});
  a.on_command(at_s(1.4), {2.0, 0.0});
  expect_twist(a.in_force(at_s(1.9) - kTick), 2.0, 0.0);
}

/// Until when in_force() is the same to the bit, by asking it.
void expect_unchanged(const Actuator& actuator, Instant now) {
  const Instant until = actuator.unchanged_until(now);
  const Twist twist = actuator.in_force(now);
  ASSERT_GE(until, now);
  for (Instant t = now; t < until && t < now + std::chrono::seconds{9}; t += from_seconds(0.01)) {
    const Twist later = actuator.in_force(t);
    ASSERT_TRUE(later.v_mps == twist.v_mps && later.omega_radps == twist.omega_radps);
  }
}

TEST_P(EachPolicy, SaysForHowLongNothingChanges) {
  Actuator a = actuator(GetParam());
  EXPECT_EQ(a.unchanged_until(at_s(0.5)), Instant::max());
  a.on_command(at_s(1), {1.0, 0.2});
  EXPECT_EQ(a.unchanged_until(at_s(1.2)), GetParam() == "hold" ? Instant::max() : at_s(1.5));
  for (int ms = 1000; ms < 4000; ms += 7) expect_unchanged(a, at_ms(ms));
  EXPECT_EQ(a.unchanged_until(at_s(60)), Instant::max());
  if (!a.takes_plans()) return;
  Plan first = plan(at_s(61), 0), next = plan(at_s(61.45), 1, 0);
  first.stamp = next.stamp = at_s(60);
  ASSERT_TRUE(a.on_plan(at_s(60), PlanSource::network, first));
  ASSERT_TRUE(a.on_plan(at_s(60), PlanSource::network, next));
  EXPECT_EQ(a.unchanged_until(at_s(60)), at_s(61));
  EXPECT_EQ(a.unchanged_until(at_s(61)), at_s(61.1));
  EXPECT_EQ(a.unchanged_until(at_s(61.41)), at_s(61.45)) << "the next takes over";
  for (int ms = 60'000; ms < 65'000; ms += 7) expect_unchanged(a, at_ms(ms));
  EXPECT_EQ(a.unchanged_until(at_s(70)), Instant::max());
}

TEST_P(EachPolicy, StandsStillLongAfterTheLastCommandUnlessItHoldsIt) {
  Actuator a = actuator(GetParam());
  a.on_command(at_s(1), {1.0, -0.2});
  const bool holds = GetParam() == "hold";
  const Twist twist = a.in_force(at_s(1e6));
  EXPECT_EQ(twist.v_mps, holds ? 1.0 : 0.0);
  EXPECT_EQ(twist.omega_radps, holds ? -0.2 : 0.0);
}

TEST_P(EachPolicy, OnlyHorizonTakesPlansAndTheOthersCountThem) {
  Actuator a = actuator(GetParam());
  const bool horizon = GetParam() == "horizon";
  EXPECT_EQ(a.takes_plans(), horizon);
  CounterList none;
  a.list(none);
  EXPECT_EQ(none.empty(), !horizon);
  EXPECT_EQ(a.on_plan(at_s(1), PlanSource::network, plan(at_s(1), 0)), horizon);
  expect_twist(a.in_force(at_s(1)), horizon ? 1.0 : 0.0, horizon ? 0.5 : 0.0);
  CounterList list;
  a.list(list);
  const std::map<std::string, std::int64_t> counters(list.begin(), list.end());
  EXPECT_EQ(counters.at(horizon ? "plan.accepted" : "plan.unasked"), 1);
}

INSTANTIATE_TEST_SUITE_P(Actuator, EachPolicy,
                         ::testing::ValuesIn(test::names_of(actuator_policies())),
                         [](const auto& info) { return info.param; });

TEST(ActuatorPolicyTable, HasARowForEachPolicyThatOurSourcesDefineOnce) {
  test::expect_has_all_rows(actuator_policies(), "common/vehicle", "ActuatorPolicy", "_policy");
}

TEST(ActuatorPolicyTable, EachPolicyIsInForceByItsNameInAScenario) {
  for (const ActuatorPolicy& policy : actuator_policies()) {
    SCOPED_TRACE(policy.name);
    const Scenario scenario = parse_scenario("", "", {"actuator.policy=" + policy.name});
    const auto& settings = scenario.get<ActuatorSettings>();
    EXPECT_EQ(&kind_of(settings), &policy);
    EXPECT_EQ(Actuator(settings, {}, {}).takes_plans(), policy.takes_plans);
  }
}

TEST(ActuatorZero, StopsExactlyAtTheTimeout) {
  Actuator a = actuator("zero");
  a.on_command(at_s(1), {1.0, 0.2});
  expect_twist(a.in_force(at_s(1.5)), 0.0, 0.0);
}

TEST(ActuatorRamp, ShrinksBothLinearlyFromTheTimeoutOn) {
  Actuator a = actuator("ramp");
  a.on_command(at_s(1), {1.0, 0.2});  // 1 m/s at 2 m/s²: 0.5 s
  expect_twist(a.in_force(at_s(1.5)), 1.0, 0.2);
  expect_twist(a.in_force(at_s(1.75)), 0.5, 0.1);
  EXPECT_GT(a.in_force(at_s(2.0) - kTick).v_mps, 0.0);
  expect_twist(a.in_force(at_s(2.0)), 0.0, 0.0);
}

TEST(ActuatorDecay, HalvesEveryLn2TimeConstantsAndEndsAtZero) {
  Actuator a = actuator("decay");
  a.on_command(at_s(1), {1.0, 0.2});
  expect_twist(a.in_force(at_s(1.5)), 1.0, 0.2);
  const Twist half = a.in_force(at_s(1.5 + 0.25 * std::log(2.0)));
  EXPECT_NEAR(half.v_mps, 0.5, 1e-8);
  EXPECT_NEAR(half.omega_radps, 0.1, 1e-8);
  const double end_s = 1.5 + 0.25 * std::log(1000.0);  // v is then 1 mm/s
  EXPECT_GT(a.in_force(at_s(end_s - 1e-6)).v_mps, 0.0);
  EXPECT_EQ(a.in_force(at_s(end_s + 1e-6)).v_mps, 0.0);
  EXPECT_EQ(a.in_force(at_s(end_s + 1e-6)).omega_radps, 0.0);
}

TEST(ActuatorDecay, AnAbsurdCommandDecaysFromWhatTheWheelsCanTurn) {
  Actuator a = actuator("decay");
  a.on_command(at_s(1), {9e8, 0.0});
  EXPECT_NEAR(a.in_force(at_s(1.5)).v_mps, 10.0, 1e-9);
}

TEST(StopRamp, IsAsFastAsTheTightestLimitAllows) {
  const StopLimits limits{2.0, 4.0, 3.0, 10.0, 1.2};
  struct Case {
    Twist from;
    double length_s;
  };
  for (const Case& c : {Case{{4.0, 0.0}, 2.0},        // speed
                        Case{{-4.0, 0.0}, 2.0},       // backwards
                        Case{{0.0, 1.0}, 0.25},       // yaw: 1 rad/s at 4 rad/s²
                        Case{{4.0, 4.0}, 6.4 / 3.0},  // the outer rim: 4 + 4 · 0.6 m/s at 3 m/s²
                        Case{{0.0, 0.0}, 0.0}}) {
    const Twist before = ramp_to_stop(c.from, from_seconds(c.length_s * 0.999), limits);
    EXPECT_NEAR(before.v_mps, 0.001 * c.from.v_mps, 1e-6);
    EXPECT_NEAR(before.omega_radps, 0.001 * c.from.omega_radps, 1e-6);
    const Twist at_end = ramp_to_stop(c.from, from_seconds(c.length_s) + kTick, limits);
    EXPECT_EQ(at_end.v_mps, 0.0);
    EXPECT_EQ(at_end.omega_radps, 0.0);
  }
}

TEST(StopRamp, BeginsWithWhatTheWheelsCanTurn) {
  const Twist twist = ramp_to_stop({8e8, 8e8}, Duration{0}, {});
  EXPECT_NEAR(twist.v_mps + twist.omega_radps * 0.6, 10.0, 1e-9);
  EXPECT_NEAR(twist.v_mps, twist.omega_radps, 1e-9);  // the same curve
}

TEST(ActuatorHorizon, ExecutesThePlanByTimeAndThenRampsToAStop) {
  Actuator a = actuator("horizon");
  Plan p = plan(at_s(1), 0);
  for (std::size_t k = 0; k < p.twists.size(); ++k) p.twists[k] = {0.1 * (1.0 + double(k)), 0.0};
  ASSERT_TRUE(a.on_plan(at_s(1), PlanSource::network, p));
  expect_twist(a.in_force(at_s(1)), 0.1, 0.0);
  expect_twist(a.in_force(at_s(1.1) - kTick), 0.1, 0.0);
  expect_twist(a.in_force(at_s(1.1)), 0.2, 0.0);
  expect_twist(a.in_force(at_s(2.0) - kTick), 1.0, 0.0);
  expect_twist(a.in_force(at_s(2.0)), 1.0, 0.0);  // the ramp begins: 0.5 s
  expect_twist(a.in_force(at_s(2.25)), 0.5, 0.0);
  expect_twist(a.in_force(at_s(2.5)), 0.0, 0.0);
  expect_twist(a.in_force(at_s(1e6)), 0.0, 0.0);
  EXPECT_EQ(a.plan(), (PlanName{7, 0})) << "standing still at the end is part of the plan";
}

TEST(ActuatorHorizon, ATwistEndsAllPlansAndAPlanEndsIt) {
  Actuator a = actuator("horizon");
  ASSERT_TRUE(a.on_plan(at_s(1), PlanSource::network, plan(at_s(1), 0)));
  ASSERT_TRUE(a.on_plan(at_s(1), PlanSource::network, plan(at_s(1.8), 1)));
  a.on_command(at_s(1.2), {-0.5, 0.0});
  EXPECT_EQ(a.plan(), PlanName{});
  expect_twist(a.in_force(at_s(1.2)), -0.5, 0.0);
  expect_twist(a.in_force(at_s(1.7)), -0.5, 0.0);
  expect_twist(a.in_force(at_s(1.9)), -0.1, 0.0);  // the ramp: 0.25 s from 1.7 s on
  EXPECT_FALSE(a.on_plan(at_s(1.9), PlanSource::network, plan(at_s(1.9), 2, 1)));  // based on 1
  EXPECT_TRUE(a.on_plan(at_s(1.9), PlanSource::network, plan(at_s(1.9), 3, Plan::kBasedOnNone)));
  expect_twist(a.in_force(at_s(1.9)), 1.0, 0.5);
}

TEST(ActuatorHorizon, ATwistGoesOnUntilAWaitingPlanTakesOver) {
  Actuator a = actuator("horizon");
  a.on_command(at_s(1), {0.5, 0.0});
  ASSERT_TRUE(a.on_plan(at_s(1.1), PlanSource::network, plan(at_s(1.3), 0)));
  expect_twist(a.in_force(at_s(1.3) - kTick), 0.5, 0.0);
  expect_twist(a.in_force(at_s(1.3)), 1.0, 0.5);
}

TEST(ActuatorHorizon, APlanIsFreshUntilItsHorizonEnds) {
  Actuator a = actuator("horizon");
  EXPECT_EQ(a.plan_age(at_s(1)), std::nullopt);
  ASSERT_TRUE(a.on_plan(at_s(1), PlanSource::network, plan(at_s(2), 0)));
  EXPECT_EQ(a.plan_age(at_s(1)), Duration{0}) << "the first plan: standing still is what it says";
  EXPECT_EQ(a.plan_age(at_s(3)), Duration{0});
  EXPECT_EQ(a.plan_age(at_s(3) + kTick), kTick);
  EXPECT_EQ(a.plan_age(at_s(5)), std::chrono::seconds{2});
  a.on_command(at_s(5), {});
  EXPECT_EQ(a.plan_age(at_s(5)), std::nullopt);
  ASSERT_TRUE(a.on_plan(at_s(5), PlanSource::network, plan(at_s(6), 1)));
  EXPECT_EQ(a.plan_age(at_s(5.5)), std::nullopt) << "the twist counts until the plan takes over";
  EXPECT_EQ(a.plan_age(at_s(6)), Duration{0});
}

}  // namespace
}  // namespace tether
