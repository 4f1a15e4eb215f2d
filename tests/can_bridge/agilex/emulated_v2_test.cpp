#include "can_bridge/agilex/emulated_v2.hpp"

#include <gmock/gmock.h>

#include <vector>

#include "can_bridge/agilex/v2_profile.hpp"
#include "can_bridge/cia402/profile.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/profiles/emulation.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "tests/can_bridge/agilex/v2_rig.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

using agilex::Condition;
using agilex::Mode;
using ::testing::IsEmpty;
using namespace tether::test;  // NOLINT(google-build-using-namespace)

// ---------------------------------------------------------------------------- emulator

Mode mode(const std::vector<CanFrame>& frames) {
  const auto state = agilex::decode_system_state(newest(frames, 0x211));
  return state ? state->mode : Mode::remote;
}

/// Powered on, booted, in CAN mode, at 0.6 s.
Chassis driving_chassis() {
  Chassis c(kStart);
  c.run_until(at_ms(599));
  c.send(agilex::mode_frame(Mode::can));
  c.run_until(at_ms(600));
  return c;
}

TEST(EmulatedAgilex, IsSilentWhileItBootsThenReportsEvery20Milliseconds) {
  Chassis c(kStart);
  EXPECT_THAT(c.run_until(at_ms(499)), IsEmpty());
  EXPECT_EQ(c.run_until(at_ms(500)).size(), 5U);
  EXPECT_THAT(c.run_until(at_ms(519)), IsEmpty());
  const auto frames = c.run_until(at_ms(1499));
  for (const std::uint32_t id : {0x211U, 0x221U, 0x251U, 0x252U, 0x311U}) {
    EXPECT_EQ(count(frames, id), 49) << std::hex << id;
  }
  EXPECT_EQ(frames.size(), 5U * 49U);
}

TEST(EmulatedAgilex, CountsItsStateFrames) {
  Chassis c(kStart);
  const auto first = agilex::decode_system_state(newest(c.run_until(at_ms(510)), 0x211));
  const auto second = agilex::decode_system_state(newest(c.run_until(at_ms(530)), 0x211));
  EXPECT_EQ(second->count, first->count + 1);
  EXPECT_DOUBLE_EQ(second->battery_V, 24.0);
}

TEST(EmulatedAgilex, IgnoresMotionInStandby) {
  Chassis c(kStart);
  c.run_until(at_ms(600));
  c.send(agilex::encode(0x111, agilex::Motion{1000, 0}));
  EXPECT_EQ(mode(c.run_until(at_ms(900))), Mode::standby);
  EXPECT_EQ(c.rim_mps(0), 0.0);
}

TEST(EmulatedAgilex, RampsToTheCommandedTwistInCanMode) {
  Chassis c = driving_chassis();
  c.send(agilex::encode(0x111, agilex::Motion{500, 500}));
  c.run_until(at_ms(700));
  // 100 ms at 2 m/s² and 4 rad/s²: 0.2 m/s and 0.4 rad/s.
  EXPECT_NEAR(c.rim_mps(0), 0.2 - 0.4 * kTrack_m / 2, 1e-9);
  EXPECT_NEAR(c.rim_mps(1), 0.2 + 0.4 * kTrack_m / 2, 1e-9);
  const auto frames = c.run_until(at_ms(999));
  EXPECT_NEAR(c.rim_mps(0), 0.5 - 0.5 * kTrack_m / 2, 1e-9);
  EXPECT_NEAR(c.rim_mps(1), 0.5 + 0.5 * kTrack_m / 2, 1e-9);
  EXPECT_EQ(mode(frames), Mode::can);
  EXPECT_EQ(agilex::decode_motion(newest(frames, 0x221)), (agilex::Motion{500, 500}));
}

TEST(EmulatedAgilex, BrakesWhenCommandsStayAwayFor500Milliseconds) {
  Chassis c = driving_chassis();
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  c.run_until(at_ms(1099));
  EXPECT_NEAR(c.rim_mps(0), 0.4, 1e-9);
  c.run_until(at_ms(1100));
  EXPECT_LT(c.rim_mps(0), 0.4);
  EXPECT_EQ(mode(c.run_until(at_ms(1300))), Mode::can);
  EXPECT_NEAR(c.rim_mps(0), 0.0, 1e-9);
  // The manual names no latch: it follows again.
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  c.run_until(at_ms(1400));
  EXPECT_GT(c.rim_mps(0), 0.1);
}

TEST(EmulatedAgilex, ACommandOfWrongLengthNeitherMovesNorFeedsTheWatchdog) {
  Chassis c = driving_chassis();
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  c.run_until(at_ms(1000));
  c.send(CanFrame::make(0x111, {0x07, 0xD0, 0, 0}));
  c.run_until(at_ms(1099));
  EXPECT_NEAR(c.rim_mps(0), 0.4, 1e-9);
  c.run_until(at_ms(1101));
  EXPECT_LT(c.rim_mps(0), 0.4);
}

TEST(EmulatedAgilex, AnExceptionBrakesItAndStaysUntilCleared) {
  Chassis c = driving_chassis();
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  c.run_until(at_ms(900));
  c.emulator.inject({0, DriveFault::Kind::fault, 0x0108}, c.now());
  auto frames = c.run_until(at_ms(1200));
  auto state = agilex::decode_system_state(newest(frames, 0x211));
  EXPECT_EQ(state->condition, Condition::exception);
  EXPECT_EQ(state->mode, Mode::standby);
  EXPECT_EQ(state->error_code, 0x0108);
  EXPECT_NEAR(c.rim_mps(0), 0.0, 1e-9);
  c.send(agilex::mode_frame(Mode::can));
  EXPECT_EQ(mode(c.run_until(at_ms(1250))), Mode::standby);
  c.send(agilex::clear_frame());
  state = agilex::decode_system_state(newest(c.run_until(at_ms(1300)), 0x211));
  EXPECT_EQ(state->condition, Condition::normal);
  EXPECT_EQ(state->error_code, 0);
}

TEST(EmulatedAgilex, ARebootForgetsModeAndWay) {
  Chassis c = driving_chassis();
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  auto frames = c.run_until(at_ms(1000));
  EXPECT_GT(agilex::decode_odometry(newest(frames, 0x311))->left_mm, 50);
  c.emulator.inject({0, DriveFault::Kind::reboot, 0}, c.now());
  EXPECT_EQ(c.rim_mps(0), 0.0);
  EXPECT_THAT(c.run_until(at_ms(1499)), IsEmpty());
  frames = c.run_until(at_ms(1510));
  EXPECT_EQ(mode(frames), Mode::standby);
  EXPECT_EQ(agilex::decode_odometry(newest(frames, 0x311)), (agilex::Odometry{0, 0}));
}

TEST(EmulatedAgilex, SilenceLastsAsLongAsAskedAndItStillHears) {
  Chassis c = driving_chassis();
  c.emulator.inject({0, DriveFault::Kind::silence, 0.2}, c.now());
  c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
  EXPECT_THAT(c.run_until(at_ms(799)), IsEmpty());
  EXPECT_GT(c.rim_mps(0), 0.1);
  EXPECT_EQ(c.run_until(at_ms(800)).size(), 5U);
  c.emulator.inject({0, DriveFault::Kind::silence, 0.0}, c.now());
  EXPECT_THAT(c.run_until(at_ms(9000)), IsEmpty());
  c.emulator.inject({0, DriveFault::Kind::none, 0.0}, c.now());
  EXPECT_EQ(c.run_until(at_ms(9020)).size(), 5U);
}

TEST(EmulatedAgilex, FrozenAndSlippingEncodersMisreportTheWay) {
  Chassis c = driving_chassis();
  const auto way_in_100_ms = [&c] {
    const auto before = agilex::decode_odometry(newest(c.run_until(c.now() + ms(20)), 0x311));
    c.send(agilex::encode(0x111, agilex::Motion{400, 0}));
    const auto after = agilex::decode_odometry(newest(c.run_until(c.now() + ms(100)), 0x311));
    return after->right_mm - before->right_mm;
  };
  for (int i = 0; i < 3; ++i) way_in_100_ms();
  EXPECT_NEAR(way_in_100_ms(), 40, 1);
  c.emulator.inject({0, DriveFault::Kind::wheel_slip, 0.5}, c.now());
  way_in_100_ms();
  EXPECT_NEAR(way_in_100_ms(), 20, 1);
  c.emulator.inject({0, DriveFault::Kind::encoder_freeze, 0}, c.now());
  way_in_100_ms();
  EXPECT_EQ(way_in_100_ms(), 0);
  c.emulator.inject({0, DriveFault::Kind::none, 0}, c.now());
  way_in_100_ms();
  EXPECT_NEAR(way_in_100_ms(), 40, 1);
}

// ---------------------------------------------------------------------------- both together

/// Profile and emulated chassis on a bus without delay.
class Loop {
 public:
  Loop() : profile(agilex_chassis(), kRadius_m, kTrack_m), c(kStart) { profile.start(kStart); }

  void run_for(int milliseconds) {
    const Instant end = c.now() + ms(milliseconds);
    while (c.now() < end) {
      for (const CanFrame& frame : c.run_until(c.now() + ms(1))) profile.on_frame(frame, c.now());
      if ((c.now() - kStart) % ms(20) != Duration{0} || hung) continue;
      std::vector<CanFrame> out;
      profile.tick(c.now(), out);
      for (const CanFrame& frame : out) c.send(frame);
    }
  }
  void to_enabled() {
    run_for(700);
    ASSERT_EQ(snapshot().phase, DrivePhase::standby);
    profile.enable();
    run_for(100);
    ASSERT_EQ(snapshot().phase, DrivePhase::enabled);
  }
  DrivetrainSnapshot snapshot() const { return profile.snapshot(c.now()); }

  AgilexV2Profile profile;
  Chassis c;
  bool hung = false;
};

TEST(AgilexLoop, FollowsItsSetpointAndFeedsItBack) {
  Loop loop;
  loop.to_enabled();
  loop.profile.set_command({0.5, 0.3});
  loop.run_for(2000);
  EXPECT_NEAR(loop.c.rim_mps(0), 0.5 - 0.3 * kTrack_m / 2, 1e-9);
  EXPECT_NEAR(loop.c.rim_mps(1), 0.5 + 0.3 * kTrack_m / 2, 1e-9);
  const DrivetrainSnapshot s = loop.snapshot();
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(s.wheels[i].speed_radps, loop.c.wheels.speed_radps[i], 0.003);
    // 1 mm of resolution and 20 ms of age.
    EXPECT_NEAR(s.wheels[i].angle_rad, loop.c.wheels.angle_rad[i],
                0.002 + 0.02 * loop.c.wheels.speed_radps[i] + 0.001);
  }
  loop.profile.stop(StopKind::quick);
  loop.run_for(1000);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::standby);
  EXPECT_TRUE(loop.snapshot().standstill);
}

TEST(AgilexLoop, ABridgeThatHangsIsStoppedByTheChassis) {
  Loop loop;
  loop.to_enabled();
  loop.profile.set_command({0.5, 0.0});
  loop.run_for(1000);
  loop.hung = true;
  loop.run_for(500 + 250 + 10);
  EXPECT_NEAR(loop.c.rim_mps(0), 0.0, 1e-9);
}

TEST(AgilexLoop, AFaultIsClearedByResetAndArmedAgain) {
  Loop loop;
  loop.to_enabled();
  loop.profile.set_command({0.5, 0.0});
  loop.run_for(1000);
  loop.c.emulator.inject({0, DriveFault::Kind::fault, 0}, loop.c.now());
  loop.run_for(1000);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::faulted);
  EXPECT_EQ(loop.snapshot().wheels[1].error_code, 1U);
  loop.profile.reset_fault();
  loop.run_for(200);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::standby);
  EXPECT_NEAR(loop.c.rim_mps(0), 0.0, 1e-9);
}

TEST(AgilexLoop, ARestartedChassisStaysAtRestUntilResetAndArmed) {
  Loop loop;
  loop.to_enabled();
  loop.profile.set_command({0.5, 0.0});
  loop.run_for(1000);
  loop.c.emulator.inject({0, DriveFault::Kind::reboot, 0}, loop.c.now());
  loop.run_for(2000);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::faulted);
  EXPECT_EQ(loop.c.rim_mps(0), 0.0);
  loop.profile.reset_fault();
  loop.run_for(200);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::standby);
  loop.profile.enable();
  loop.run_for(200);
  EXPECT_EQ(loop.snapshot().phase, DrivePhase::enabled);
  EXPECT_EQ(loop.c.rim_mps(0), 0.0) << "the old command is forgotten";
}

TEST(MakeDrivetrain, BothEndsFollowTheFilesProfile) {
  DrivetrainConfig config = agilex_chassis();
  const VehicleConfig vehicle;
  EXPECT_NE(dynamic_cast<AgilexV2Profile*>(make_drive_profile(config, vehicle).get()), nullptr);
  EXPECT_NE(dynamic_cast<EmulatedAgilexV2*>(make_emulated_drivetrain(config, kStart).get()),
            nullptr);
  config = load_drivetrain(in_source("/drivetrains/two_node_cia402.toml"));
  EXPECT_NE(dynamic_cast<Cia402Profile*>(make_drive_profile(config, vehicle).get()), nullptr);
  EXPECT_NE(dynamic_cast<EmulatedCia402*>(make_emulated_drivetrain(config, kStart).get()), nullptr);
}

}  // namespace
}  // namespace tether
