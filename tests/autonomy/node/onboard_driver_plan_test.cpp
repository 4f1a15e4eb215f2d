#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "tests/autonomy/support/onboard_rig.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

class PlansOfARemoteDriver : public test::OnboardRig {
 protected:
  using OnboardRig::OnboardRig;

  /// From now on: `v_mps` for a while, decided now, by a report of now.
  Plan plan(double v_mps, double duration_s) {
    Plan plan;
    plan.stamp = plan.start = now_;
    plan.pose = now_;
    plan.seq = seq_++;
    plan.name = {1, plan.seq};
    plan.step = milliseconds{100};
    plan.twists.assign(static_cast<std::size_t>(std::lround(duration_s / 0.1)), {v_mps, 0.0});
    return plan;
  }
  void send(Plan plan) { driver_.on_plan(now_, PlanSource::network, std::move(plan)); }
  void take_over() {
    ask();
    send(plan(0.0, 1.0));
    pass(kStep_s);
    ASSERT_EQ(out_.state, DriveState::remote);
  }
  /// Such plans come for a second while it follows one that goes on for 10 s.
  template <class Make>
  void keep_sending(Make make) {
    take_over();
    send(plan(-0.2, 10.0));
    pass(0.4);
    ASSERT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
    for (int i = 0; i < 10; ++i) {
      send(make());
      pass(0.1);
    }
  }
  void expect_without_driver() const {
    EXPECT_EQ(out_.driver, Driver::none);
    EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  }
};

class PlansWhereTheActuatorTakesNone : public PlansOfARemoteDriver {
 protected:
  PlansWhereTheActuatorTakesNone() : PlansOfARemoteDriver("hold") {}
};

TEST_F(PlansOfARemoteDriver, AreFollowedAfterOneThatStandsStill) {
  ask();
  send(plan(-0.2, 5.0));
  pass(0.1);
  EXPECT_EQ(out_.state, DriveState::remote_requested);
  send(plan(0.0, 1.0));
  send(plan(-0.2, 5.0));
  pass(0.4);
  EXPECT_EQ(out_.driver, Driver::remote);
  EXPECT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
  EXPECT_EQ(counter("remote.not_from_rest"), 1);
}

TEST_F(PlansOfARemoteDriver, AreFollowedNoLongerThanADriverMayBeSilentWhateverTheirLength) {
  take_over();
  send(plan(-0.2, 100.0));
  pass(0.48);
  EXPECT_EQ(out_.driver, Driver::remote);
  pass(0.02);
  EXPECT_EQ(out_.driver, Driver::none);
  pass(0.2);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  const Pose2 rest = pose_;
  pass(10.0);
  EXPECT_EQ(pose_.x_m, rest.x_m);
}

TEST_F(PlansOfARemoteDriver, ThatNameAnOldReportOrNoneAreRefused) {
  take_over();
  const Instant seen = now_;
  pass(1.02);
  Plan blind = plan(-0.2, 5.0);
  blind.pose = seen;
  send(blind);
  Plan nameless = plan(-0.2, 5.0);
  nameless.pose.reset();
  send(nameless);
  pass(0.5);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_EQ(counter("remote.old"), 1);
  EXPECT_EQ(counter("remote.other_handover"), 1);
  EXPECT_EQ(counter("plan.received"), 1) << "the one that took over";
}

TEST_F(PlansOfARemoteDriver, OfBeforeAnotherRequestStayEnded) {
  take_over();
  send(plan(-0.2, 100.0));
  pass(settings_.get<AutonomySettings>().wait_s + 1.0);
  ASSERT_EQ(out_.state, DriveState::remote_requested);
  Plan later = plan(0.0, 1.0);
  later.start = now_ + seconds{5};
  send(later);
  pass(0.3);
  EXPECT_EQ(out_.driver, Driver::remote);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0) << "until the new one begins";
}

TEST_F(PlansOfARemoteDriver, FromAnOlderClockThanTheVehiclesCountAtOnce) {
  ask();
  for (const double v_mps : {0.0, -0.2}) {
    Plan late = plan(v_mps, 5.0);
    late.stamp -= milliseconds{300};
    late.start -= milliseconds{300};
    send(late);
  }
  pass(0.4);
  EXPECT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
}

TEST_F(PlansOfARemoteDriver, ThatAreOverNeitherMoveItNorKeepAnOlderOneGoing) {
  keep_sending([this] {
    Plan past = plan(-0.2, 1.0);
    past.start = now_ - seconds{1};
    return past;
  });
  expect_without_driver();
  EXPECT_EQ(counter("plan.expired"), 10);
  EXPECT_EQ(counter("remote.not_followed"), 10);
}

TEST_F(PlansOfARemoteDriver, ThatMakeNoSenseDoNotEither) {
  keep_sending([this] { return plan(std::numeric_limits<double>::quiet_NaN(), 1.0); });
  expect_without_driver();
  EXPECT_EQ(counter("plan.unusable"), 10);
}

TEST_F(PlansOfARemoteDriver, ThatAreOverDoNotTakeItOver) {
  ask();
  Plan past = plan(0.0, 1.0);
  past.start = now_ - seconds{1};
  send(past);
  EXPECT_EQ(driver_.supervisor().state(), DriveState::remote_requested);
}

TEST_F(PlansOfARemoteDriver, EndAtStandstillThoughTheDriverIsHeard) {
  take_over();
  const Instant end = now_ + seconds{1};
  while (now_ < end) {
    Plan rest_of_it = plan(-0.2, 1.0);
    rest_of_it.start = end - seconds{1};
    send(rest_of_it);
    pass(0.1);
  }
  EXPECT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
  pass(0.34);
  EXPECT_EQ(out_.driver, Driver::remote);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
}

TEST_F(PlansOfARemoteDriver, AreNoFasterThanARemoteDriverMayBe) {
  take_over();
  for (int i = 0; i < 10; ++i) {
    send(plan(-2.0, 1.0));
    pass(0.1);
  }
  EXPECT_DOUBLE_EQ(out_.setpoint.v_mps, -settings_.get<AutonomySettings>().remote_speed_mps);
}

TEST_F(PlansOfARemoteDriver, IntoTheBoxStopBeforeIt) {
  take_over();
  for (int i = 0; i < 50; ++i) {
    send(plan(0.5, 1.0));
    pass(0.1);
  }
  EXPECT_NEAR(pose_.x_m, 0.0, 0.01) << "there are 0.3 m to it, which is the margin";
}

TEST_F(PlansWhereTheActuatorTakesNone, NeitherTakeItOverNorKeepATwistGoing) {
  ask();
  send(plan(0.0, 1.0));
  EXPECT_EQ(driver_.supervisor().state(), DriveState::remote_requested);
  driver_.on_command(now_, now_ + milliseconds{1}, seq_++, {}, now_);
  pass(0.02);
  driver_.on_command(now_, now_, seq_++, {-0.2, 0.0}, now_);
  pass(0.4);
  ASSERT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
  for (int i = 0; i < 10; ++i) {
    send(plan(-0.2, 1.0));
    pass(0.1);
  }
  expect_without_driver();
  EXPECT_EQ(counter("plan.unasked"), 11);
}

}  // namespace
}  // namespace tether
