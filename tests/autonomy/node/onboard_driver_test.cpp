#include <gtest/gtest.h>

#include "tests/autonomy/support/onboard_rig.hpp"

namespace tether {
namespace {

using OnboardDriverTest = test::OnboardRig;

TEST_F(OnboardDriverTest, StandsBeforeTheRunBeginsAndThenDrivesItsPath) {
  now_ = kStart - std::chrono::seconds{3};
  pose_.x_m = -0.1;  // its law would go there
  pass(2.98);
  EXPECT_EQ(out_.driver, Driver::law);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_EQ(driver_.follower().clock_s(), 0.0);
  pass(3.0);
  EXPECT_NEAR(out_.setpoint.v_mps, 1.2, 0.05);
}

TEST_F(OnboardDriverTest, StopsBeforeWhatStandsInItsWayWithTheMarginLeft) {
  block(4.0);
  pass(8.0);
  EXPECT_EQ(out_.state, DriveState::protective_stop);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_NEAR(pose_.x_m, 4.0 - 0.3, 0.03);
}

TEST_F(OnboardDriverTest, ComesToRestWithinItsFieldWhenSomethingAppears) {
  pass(4.0);
  ASSERT_GT(out_.setpoint.v_mps, 1.1);
  const double from_m = pose_.x_m;
  block(1.26);  // 1.2²/2 + 0.2 · 1.2 + 0.3
  pass(2.0);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_LT(pose_.x_m, from_m + 1.26 - 0.25);
}

TEST_F(OnboardDriverTest, StandsWhenItGetsNoPoseForLong) {
  pass(3.0);
  localised_ = false;
  pass(0.5);
  EXPECT_EQ(out_.driver, Driver::law);
  pass(0.02);
  EXPECT_EQ(driver_.supervisor().reason(), "localisation is lost");
  pass(1.2);
  EXPECT_EQ(out_.state, DriveState::protective_stop);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
}

TEST_F(OnboardDriverTest, StandsWhenItsLocaliserSaysThatItIsLostThoughPosesCome) {
  pass(3.0);
  driver_.on_localisation(false);
  pass(0.02);
  EXPECT_EQ(driver_.supervisor().reason(), "localisation is lost");
  pass(1.2);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  driver_.on_localisation(true);
  pass(2.0);
  EXPECT_EQ(out_.driver, Driver::law);
}

TEST_F(OnboardDriverTest, StandsWhenItsScannerIsSilent) {
  pass(3.0);
  sees_ = false;
  pass(0.3);
  EXPECT_EQ(out_.driver, Driver::none);
  EXPECT_TRUE(driver_.supervisor().reason().starts_with("the newest scan is"));
  pass(1.2);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
}

TEST_F(OnboardDriverTest, StandsWhenItsWheelsDoNotFollow) {
  pass(3.0);
  wheels_ = Twist{};
  pass(0.5);
  EXPECT_EQ(out_.driver, Driver::law);
  pass(0.04);
  EXPECT_EQ(out_.state, DriveState::protective_stop);
  EXPECT_EQ(driver_.supervisor().reason(), "the wheels do not follow");
}

TEST_F(OnboardDriverTest, PushesAgainstWhatItsScannerDoesNotSeeForLessThanAMetreOfItsWheels) {
  pass(3.0);
  held_ = true;
  pass(0.3);
  EXPECT_EQ(out_.driver, Driver::law) << "0.36 m are not 0.4";
  pass(0.1);
  EXPECT_EQ(out_.state, DriveState::protective_stop);
  EXPECT_EQ(driver_.supervisor().reason(), "poses do not move as the wheels do");
  const double clock_s = driver_.follower().clock_s();
  pass(3.0);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_LT(slipped_m_, 1.3);
  EXPECT_LT(driver_.follower().clock_s(), clock_s + 1.2) << "the reference waits";
}

TEST_F(OnboardDriverTest, NoRemoteDriverPushesEither) {
  ask();
  const auto drive = [&](double v_mps) {
    driver_.on_command(now_, now_, seq_++, {v_mps, 0.0}, now_);
    pass(0.1);
  };
  drive(0.0);
  shapes_ = test::hall(12.0);
  block(6.0);  // nothing in the way, and it is not on its path: it does not go on by itself
  pose_.y_m = 0.5;
  slipped_m_ = 0.0;
  for (int i = 0; i < 20; ++i) drive(0.0);
  held_ = true;
  double rolled_m = 0.0;
  for (int i = 0; i < 50; ++i) {
    const double before_m = slipped_m_;
    drive(0.4);
    rolled_m = std::max(rolled_m, slipped_m_ - before_m);
    if (i > 20 && out_.setpoint.v_mps == 0.0) break;
  }
  EXPECT_GT(rolled_m, 0.0) << "it was driven";
  EXPECT_EQ(out_.driver, Driver::none);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
  EXPECT_LT(slipped_m_, 1.5);
}

TEST_F(OnboardDriverTest, WheelsThatRollTowardsAnObstacleWithoutACommandAreAProtectiveStop) {
  now_ = kStart - std::chrono::seconds{1};
  block(0.3);
  wheels_ = Twist{0.25, 0.0};
  pass(0.1);
  EXPECT_EQ(driver_.supervisor().reason(), "something is in the stopping field");
}

TEST_F(OnboardDriverTest, IsNotTakenOverWhileItsWheelsRoll) {
  ask();
  wheels_ = Twist{-0.1, 0.0};
  pass(0.02);
  driver_.on_command(now_, now_, 0, {}, now_);
  EXPECT_EQ(counter("remote.not_from_rest"), 1);
  wheels_.reset();
  pass(0.02);
  driver_.on_command(now_, now_, 1, {}, now_);
  pass(0.02);
  EXPECT_EQ(out_.driver, Driver::remote);
}

TEST_F(OnboardDriverTest, IsNotTakenOverWhileItsCountersSayThatItRollsThoughTheSpeedReadsZero) {
  ask();
  wheels_ = Twist{};
  for (int i = 0; i < 20; ++i) {
    slipped_m_ -= 0.004;
    pass(0.02);
  }
  driver_.on_command(now_, now_, 0, {}, now_);
  EXPECT_EQ(counter("remote.not_from_rest"), 1);
}

TEST_F(OnboardDriverTest, StandsWhenTwoRemoteDriversSend) {
  ask();
  driver_.on_command(now_, now_, 0, {}, now_);
  pass(0.02);
  driver_.on_command(now_, now_, 1, {-0.2, 0.0}, now_);
  pass(0.3);
  ASSERT_DOUBLE_EQ(out_.setpoint.v_mps, -0.2);
  driver_.on_senders(true);
  driver_.on_command(now_, now_, 2, {-0.2, 0.0}, now_);
  pass(0.3);
  EXPECT_EQ(out_.driver, Driver::none);
  EXPECT_EQ(out_.setpoint.v_mps, 0.0);
}

}  // namespace
}  // namespace tether
