#include <gtest/gtest.h>

#include <cmath>

#include "controller/node/controller_node.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using Trigger = ControllerSettings::Trigger;

ControllerSettings changes(Trigger trigger, double max_age_s) {
  ControllerSettings settings;
  settings.send = ControllerSettings::Send::changed;
  settings.trigger = trigger;
  settings.rate_hz = 10.0;
  settings.send_max_age_s = max_age_s;
  return settings;
}

Instant at_ms(int ms) { return kStart + milliseconds{ms}; }

struct TwistSending : ::testing::Test {
  CommandSending sending{changes(Trigger::timer, 1.0)};
  bool due(int ms, double v_mps, double omega_radps = 0.0, bool stopped = false) {
    return sending.is_due(at_ms(ms), Twist{v_mps, omega_radps}, stopped, nullptr);
  }
};

TEST_F(TwistSending, SendsWhatIsOffTheLastOneSentByMoreThanTheDelta) {
  EXPECT_TRUE(due(0, 1.0));
  EXPECT_FALSE(due(100, 1.04));
  EXPECT_TRUE(due(200, 1.06));  // off 1.0, which was sent, not 1.04, which was not
  EXPECT_FALSE(due(300, 1.02));
  EXPECT_TRUE(due(400, 1.06, 0.06));
  EXPECT_FALSE(due(500, 1.06, 0.02));
}

TEST_F(TwistSending, SendsAnyTwistBeforeItsAgeLimitIsPassed) {
  EXPECT_TRUE(due(0, 1.0));
  for (int ms = 100; ms < 1000; ms += 100) EXPECT_FALSE(due(ms, 1.0)) << ms;
  EXPECT_TRUE(due(1000, 1.0));
  EXPECT_FALSE(due(1100, 1.0));
  EXPECT_TRUE(due(1950, 1.0)) << "the next decision, at 2050 ms, would be too late";
}

TEST_F(TwistSending, NeverKeepsAStandstillForItself) {
  EXPECT_TRUE(due(0, 0.04));
  EXPECT_TRUE(due(100, 0.0)) << "off by less than the delta";
  EXPECT_FALSE(due(200, 0.0));
  EXPECT_TRUE(due(300, 0.01)) << "nor that it is over";
  EXPECT_TRUE(due(400, 0.01, 0.0, true)) << "nor a stop for want of poses";
}

TEST(EventSending, SendsTheFirstDecisionThatIsLate) {
  CommandSending sending(changes(Trigger::event, 0.2));
  EXPECT_TRUE(sending.is_due(at_ms(0), Twist{1.0, 0.0}, false, nullptr));
  EXPECT_FALSE(sending.is_due(at_ms(190), Twist{1.0, 0.0}, false, nullptr));
  EXPECT_TRUE(sending.is_due(at_ms(230), Twist{1.0, 0.0}, false, nullptr));
}

/// v(t) = 1 + sin t in the mean of each step of 100 ms, plus `off`, for 5 s.
Plan plan_from(int start_ms, std::int64_t id, double off_mps = 0.0) {
  Plan plan;
  plan.name = {7, id};
  plan.start = at_ms(start_ms);
  plan.step = milliseconds{100};
  for (int i = 0; i < 50; ++i) {
    const double from = start_ms * 1e-3 + 0.1 * i;
    plan.twists.push_back({1.0 + (std::cos(from) - std::cos(from + 0.1)) / 0.1 + off_mps, 0.0});
  }
  return plan;
}

struct PlanSending : ::testing::Test {
  static ControllerSettings settings() {
    auto all = changes(Trigger::timer, 3.0);
    all.send_delta_mps = 0.01;
    return all;
  }
  CommandSending sending{settings()};
  bool due(int ms, const Plan& plan, const SeenPose* newest = nullptr) {
    return sending.is_due(at_ms(ms), plan, false, newest);
  }
  static SeenPose pose(int ms, std::optional<std::int64_t> plan_id) {
    SeenPose seen;
    seen.stamp = at_ms(ms);
    seen.plan_id = plan_id;
    return seen;
  }
};

// A step of 100 ms changes its speed by up to 0.1 m/s, ten deltas; two plans of one motion, whose
// steps begin at other times, do not differ.
TEST_F(PlanSending, DoesNotRepeatAPlanThatGoesOnAsTheOneSent) {
  EXPECT_TRUE(due(0, plan_from(0, 0)));
  EXPECT_FALSE(due(133, plan_from(133, 1)));
  EXPECT_FALSE(due(250, plan_from(250, 2, 0.005)));
  EXPECT_TRUE(due(350, plan_from(350, 3, 0.013)));
}

TEST_F(PlanSending, SendsOneThatDiffersInASingleStepThatBothHave) {
  EXPECT_TRUE(due(0, plan_from(0, 0)));
  Plan later = plan_from(1000, 1);
  later.twists.back().v_mps += 1.0;  // beyond the end of the one sent
  EXPECT_FALSE(due(100, later));
  later.twists[30].omega_radps = 0.06;
  EXPECT_TRUE(due(200, later));
}

TEST_F(PlanSending, SendsAStopAndWhatFollowsIt) {
  Plan stop;
  stop.start = at_ms(100);
  stop.step = milliseconds{100};
  stop.twists = {Twist{}};
  EXPECT_TRUE(due(0, plan_from(0, 0)));
  EXPECT_TRUE(due(100, stop));
  EXPECT_TRUE(due(200, plan_from(200, 2)));
}

TEST_F(PlanSending, RepeatsWhatAPoseSaysTheVehicleDoesNotFollow) {
  EXPECT_TRUE(due(0, plan_from(0, 0)));
  EXPECT_TRUE(due(500, plan_from(500, 1, 0.1)));
  const SeenPose before = pose(450, 0), got_it = pose(600, 1), lost = pose(600, 0);
  EXPECT_FALSE(due(550, plan_from(600, 2, 0.1), &before)) << "it cannot have begun";
  EXPECT_FALSE(due(650, plan_from(700, 3, 0.1), &got_it));
  EXPECT_TRUE(due(660, plan_from(700, 4, 0.1), &lost));
}

TEST_F(PlanSending, RepeatsAPlanBeforeItsAgeLimitIsPassed) {
  EXPECT_TRUE(due(0, plan_from(0, 0)));
  EXPECT_FALSE(due(2900, plan_from(2900, 1)));
  EXPECT_TRUE(due(3000, plan_from(3000, 2)));
}

}  // namespace
}  // namespace tether
