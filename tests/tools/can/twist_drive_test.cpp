#include "tools/can/twist_drive.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>

namespace tether {
namespace {

using ::testing::HasSubstr;
using Phase = TwistDrive::Phase;
using State = drivetrain_state_t;

constexpr Duration kStep = TwistDrive::kPeriod;

/// A drive with the bridge's reports between its steps.
struct Drive {
  explicit Drive(const Twist& twist, Duration duration = std::chrono::seconds{2})
      : drive(twist, duration, now) {
    state.state = State::DISARMED;
    state.state_name = "disarmed";
  }

  Twist step() {
    now += kStep;
    if (speaks) {
      drive.on_state(state, now);
      drive.on_odometry(odometry);
    }
    return drive.step(now);
  }
  /// Follows like the bridge: its setpoint is the command.
  Twist step_and_follow() {
    const Twist twist = step();
    state.v_mps = odometry.v_mps = twist.v_mps;
    state.omega_radps = odometry.omega_radps = twist.omega_radps;
    odometry.distance_m += std::abs(twist.v_mps) * to_seconds(kStep);
    odometry.yaw_rad = wrap_angle(odometry.yaw_rad + twist.omega_radps * to_seconds(kStep));
    return twist;
  }
  void run(Duration duration) {
    for (const Instant end = now + duration; now < end;) step_and_follow();
  }
  void arm() {
    state.state = State::ARMED;
    state.state_name = "armed";
    while (drive.phase() == Phase::waiting) step_and_follow();
  }
  void stop_for(const char* reason) {
    state.state = State::FAULT;
    state.state_name = "fault";
    state.reason = reason;
  }

  Instant now = kStart;
  bool speaks = true;
  drivetrain_state_t state{};
  odometry_t odometry{};
  TwistDrive drive;
};

TEST(TwistDrive, CommandsZeroUntilArmed) {
  Drive d({0.1, 0.0});
  for (int i = 0; i < 100; ++i) EXPECT_EQ(d.step_and_follow().v_mps, 0.0);
  d.arm();
  EXPECT_EQ(d.drive.phase(), Phase::driving);
  EXPECT_EQ(d.step_and_follow().v_mps, 0.1);
}

TEST(TwistDrive, CommandsZeroFirstEvenWhenArmedAlready) {
  Drive d({0.1, 0.0});
  d.state.state = State::ARMED;
  EXPECT_EQ(d.step().v_mps, 0.0);
  d.arm();
  EXPECT_GE(d.now - kStart, TwistDrive::kFirstZeros);
}

TEST(TwistDrive, DrivesForItsTimeThenZeroUntilItStandsAndReportsDistanceAndYaw) {
  Drive d({0.5, 4.0}, std::chrono::seconds{10});
  d.odometry.distance_m = 7.0;
  d.odometry.yaw_rad = 3.0;
  d.arm();
  d.run(std::chrono::milliseconds{9900});
  EXPECT_EQ(d.drive.phase(), Phase::driving);
  d.run(std::chrono::milliseconds{200});
  EXPECT_EQ(d.drive.phase(), Phase::stopping);
  EXPECT_EQ(d.step().v_mps, 0.0);
  d.run(TwistDrive::kLastZeros);
  EXPECT_EQ(d.drive.phase(), Phase::done);
  EXPECT_EQ(d.drive.failure(), "");
  EXPECT_NEAR(d.drive.distance_m(), 5.0, 0.03);
  EXPECT_NEAR(d.drive.yaw_rad(), 40.0, 0.3) << "turns on beyond pi";
}

TEST(TwistDrive, IsNotDoneWhileTheWheelsTurn) {
  Drive d({0.5, 0.0});
  d.arm();
  d.run(std::chrono::milliseconds{2100});
  d.odometry.v_mps = 0.2;
  for (int i = 0; i < 100; ++i) d.step();
  EXPECT_EQ(d.drive.phase(), Phase::stopping);
  for (int i = 0; i < 120; ++i) d.step();
  EXPECT_EQ(d.drive.phase(), Phase::done);
  EXPECT_THAT(d.drive.failure(), HasSubstr("does not stand"));
}

TEST(TwistDrive, GivesUpWithTheReasonWhenTheDrivetrainStops) {
  Drive d({0.5, 0.0});
  d.arm();
  d.run(kStep * 5);
  d.stop_for("right drive (node 2): it does not follow");
  EXPECT_EQ(d.step().v_mps, 0.0);
  EXPECT_THAT(d.drive.failure(), HasSubstr("fault: right drive (node 2): it does not follow"));
  EXPECT_EQ(d.drive.phase(), Phase::stopping);
  d.run(TwistDrive::kLastZeros);
  EXPECT_EQ(d.drive.phase(), Phase::done);
}

TEST(TwistDrive, NeverGoesOnWhenItIsArmedAgain) {
  Drive d({0.5, 0.0});
  d.arm();
  d.run(kStep * 5);
  d.stop_for("");
  d.step();
  d.state.state = State::ARMED;
  for (int i = 0; i < 20; ++i) EXPECT_EQ(d.step().v_mps, 0.0);
}

TEST(TwistDrive, GivesUpWhenTheBridgeIsSilent) {
  for (const bool driving : {false, true}) {
    Drive d({0.5, 0.0});
    if (driving) d.arm();
    d.run(kStep * 4);
    d.speaks = false;
    const Instant silent = d.now;
    while (d.drive.failure().empty()) {
      d.step();
      ASSERT_LT(d.now - silent, 2 * TwistDrive::kSilence);
    }
    EXPECT_THAT(d.drive.failure(), HasSubstr("CAN/STATE is silent"));
    EXPECT_EQ(d.step().v_mps, 0.0);
  }
}

TEST(TwistDrive, GivesUpWhenTheBridgesLimitsCutTheTwist) {
  Drive d({0.5, 0.0}, std::chrono::seconds{10});
  d.arm();
  while (d.drive.failure().empty()) {
    d.step();
    d.state.v_mps = std::min(0.1, d.state.v_mps + 0.01);
    ASSERT_LT(d.now - kStart, std::chrono::seconds{5});
  }
  EXPECT_THAT(d.drive.failure(), HasSubstr("makes 0.100 m/s, 0.000 rad/s of it"));
  EXPECT_THAT(d.drive.failure(), HasSubstr("can.max_speed_mps"));
}

TEST(TwistDrive, ASlowRampIsNoLimit) {
  Drive d({0.5, 0.0}, std::chrono::seconds{10});
  d.arm();
  for (int i = 0; i < 150; ++i) {
    d.step();
    d.state.v_mps = 0.001 * i;
  }
  EXPECT_EQ(d.drive.failure(), "");
}

TEST(TwistDrive, GivesUpWithoutArming) {
  Drive d({0.5, 0.0});
  d.run(TwistDrive::kArmPatience + TwistDrive::kLastZeros + 2 * kStep);
  EXPECT_EQ(d.drive.phase(), Phase::done);
  EXPECT_THAT(d.drive.failure(), HasSubstr("was not armed"));
}

TEST(TwistDrive, InterruptedOrWithAnotherSenderItCommandsZeroForAWhile) {
  for (const bool interrupted : {true, false}) {
    Drive d({0.5, 0.0});
    d.arm();
    d.run(kStep * 4);
    interrupted ? d.drive.interrupt(d.now) : d.drive.on_foreign_command(d.now);
    const Instant since = d.now;
    while (d.drive.phase() != Phase::done) EXPECT_EQ(d.step().v_mps, 0.0);
    EXPECT_GE(d.now - since, TwistDrive::kLastZeros);
    EXPECT_THAT(d.drive.failure(), HasSubstr(interrupted ? "interrupted" : "another sender"));
  }
}

}  // namespace
}  // namespace tether
