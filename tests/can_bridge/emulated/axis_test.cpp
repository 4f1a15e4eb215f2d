#include "can_bridge/emulated/axis.hpp"

#include <gtest/gtest.h>

namespace tether {
namespace {

using canopen::DriveState;

/// An axis in rpm with a wheel that follows its setpoint, under a fake clock of 1 ms.
struct Bench {
  EmulatedAxis axis;
  EmulatedAxis::Settings s{.mode = 3,
                           .acceleration = 100.0,
                           .deceleration = 200.0,
                           .quick_stop_deceleration = 1000.0,
                           .max_speed = 300.0};
  bool wheel_follows = true;

  Bench() { run(20); }

  void run(int milliseconds) {
    for (int i = 0; i < milliseconds; ++i) {
      if (wheel_follows) s.actual = axis.setpoint();
      axis.tick(s, std::chrono::milliseconds{1});
    }
  }
  DriveState command(std::uint16_t word, int milliseconds = 1) {
    axis.write_control(word);
    run(milliseconds);
    return axis.state();
  }
  void enable() {
    command(0x06);
    command(0x07);
    ASSERT_EQ(command(0x0F), DriveState::operation_enabled);
  }
  void enable_at(double speed) {
    enable();
    s.target = speed;
    for (int i = 0; i < 20'000 && axis.setpoint() != speed; ++i) run(1);
    ASSERT_EQ(axis.setpoint(), speed);
    run(1);
  }
  bool bit(int n) const { return (axis.statusword() >> n & 1) != 0; }
};

// ---------------------------------------------------------------------------- states

TEST(EmulatedAxis, TestsItselfFor20MsBeforeSwitchOnDisabled) {
  EmulatedAxis axis;
  for (int i = 0; i < 19; ++i) axis.tick({}, std::chrono::milliseconds{1});
  EXPECT_EQ(axis.state(), DriveState::not_ready);
  EXPECT_EQ(axis.statusword(), 0);
  axis.tick({}, std::chrono::milliseconds{1});
  EXPECT_EQ(axis.state(), DriveState::switch_on_disabled);
}

TEST(EmulatedAxis, GoesUpStepByStepAndShowsItInTheStatusword) {
  Bench b;
  EXPECT_EQ(b.axis.statusword() & 0x4F, 0x40);
  EXPECT_EQ(b.command(0x06), DriveState::ready_to_switch_on);
  EXPECT_EQ(b.axis.statusword() & 0x6F, 0x21);
  EXPECT_EQ(b.command(0x07), DriveState::switched_on);
  EXPECT_EQ(b.axis.statusword() & 0x6F, 0x23);
  EXPECT_EQ(b.command(0x0F), DriveState::operation_enabled);
  EXPECT_EQ(b.axis.statusword() & 0x6F, 0x27);
}

TEST(EmulatedAxis, OnlyShutdownLeadsOutOfSwitchOnDisabled) {
  for (const int word : {0x00, 0x02, 0x07, 0x0F, 0x80, 0x86, 0x8F, 0x10F}) {
    Bench b;
    EXPECT_EQ(b.command(static_cast<std::uint16_t>(word), 5), DriveState::switch_on_disabled)
        << std::hex << word;
  }
}

TEST(EmulatedAxis, AHeldEnableTakesTwoSteps) {
  Bench b;
  b.command(0x06);
  EXPECT_EQ(b.command(0x0F), DriveState::switched_on);
  b.run(1);
  EXPECT_EQ(b.axis.state(), DriveState::operation_enabled);
}

TEST(EmulatedAxis, DoesNotEnableOutsideProfileVelocityMode) {
  for (const int mode : {0, 1, 2, 4}) {
    Bench b;
    b.s.mode = mode;
    b.command(0x06);
    b.command(0x07);
    EXPECT_EQ(b.command(0x0F, 10), DriveState::switched_on) << mode;
    EXPECT_FALSE(b.axis.powered());
  }
}

TEST(EmulatedAxis, GoesDownAsTheStandardSays) {
  struct Case {
    int from, word;
    DriveState to;
  };
  const Case kCases[] = {
      {1, 0x00, DriveState::switch_on_disabled}, {1, 0x02, DriveState::switch_on_disabled},
      {2, 0x00, DriveState::switch_on_disabled}, {2, 0x02, DriveState::switch_on_disabled},
      {2, 0x06, DriveState::ready_to_switch_on}, {3, 0x00, DriveState::switch_on_disabled},
      {3, 0x06, DriveState::ready_to_switch_on}, {3, 0x07, DriveState::switched_on},
  };
  for (const Case& c : kCases) {
    Bench b;
    b.command(0x06);
    if (c.from > 1) b.command(0x07);
    if (c.from > 2) b.command(0x0F);
    EXPECT_EQ(b.command(static_cast<std::uint16_t>(c.word)), c.to) << c.from << " " << c.word;
  }
}

TEST(EmulatedAxis, PowerOffMeansZeroAtOnce) {
  for (const std::uint16_t word : {std::uint16_t{0x00}, std::uint16_t{0x06}}) {
    Bench b;
    b.enable_at(100.0);
    b.command(word);
    EXPECT_EQ(b.axis.setpoint(), 0.0) << word;
    EXPECT_FALSE(b.axis.powered());
  }
}

TEST(EmulatedAxis, DisableOperationRampsDownFirst) {
  Bench b;
  b.enable_at(100.0);
  b.command(0x07, 499);
  EXPECT_EQ(b.axis.state(), DriveState::operation_enabled);
  b.run(2);
  EXPECT_EQ(b.axis.state(), DriveState::switched_on);
}

// ---------------------------------------------------------------------------- velocity

TEST(EmulatedAxis, AcceleratesAtItsAccelerationAndReachesTheTargetOnTime) {
  Bench b;
  b.enable();
  b.s.target = 50.0;
  b.run(499);
  EXPECT_NEAR(b.axis.setpoint(), 49.9, 1e-9);
  EXPECT_LT(b.axis.setpoint(), 50.0);
  b.run(1);
  EXPECT_NEAR(b.axis.setpoint(), 50.0, 1e-9);
  b.run(1);
  EXPECT_EQ(b.axis.setpoint(), 50.0);
}

TEST(EmulatedAxis, SlowsDownAtItsDeceleration) {
  Bench b;
  b.enable_at(100.0);
  b.s.target = 20.0;
  b.run(200);
  EXPECT_NEAR(b.axis.setpoint(), 60.0, 1e-9);
  b.run(201);
  EXPECT_EQ(b.axis.setpoint(), 20.0);
}

TEST(EmulatedAxis, ReversesWithDecelerationToZeroAndAccelerationBeyond) {
  Bench b;
  b.enable_at(20.0);
  b.s.target = -20.0;
  b.run(100);
  EXPECT_NEAR(b.axis.setpoint(), 0.0, 0.25);
  b.run(100);
  EXPECT_NEAR(b.axis.setpoint(), -10.0, 0.25);
}

TEST(EmulatedAxis, ClampsToTheMaximumSpeedAndSaysSo) {
  Bench b;
  b.enable();
  b.s.target = 300.0;
  b.run(1);
  EXPECT_FALSE(b.bit(11));
  b.s.target = 301.0;
  b.run(4000);
  EXPECT_EQ(b.axis.setpoint(), 300.0);
  EXPECT_TRUE(b.bit(11));
}

TEST(EmulatedAxis, TellsWhenTheWheelIsAtItsTarget) {
  Bench b;
  b.wheel_follows = false;
  b.enable();
  b.s.target = 10.0;
  b.s.actual = 8.99;
  b.run(1);
  EXPECT_FALSE(b.bit(10));
  b.s.actual = 9.0;
  b.run(1);
  EXPECT_TRUE(b.bit(10));
}

TEST(EmulatedAxis, TellsWhenTheWheelStandsInEveryState) {
  Bench b;
  b.wheel_follows = false;
  b.s.actual = 1.01;
  b.run(1);
  EXPECT_FALSE(b.bit(12));
  b.s.actual = -1.0;
  b.run(1);
  EXPECT_TRUE(b.bit(12));
}

TEST(EmulatedAxis, HaltRampsToZeroAndStaysEnabled) {
  Bench b;
  b.enable_at(100.0);
  b.command(0x10F, 250);
  EXPECT_NEAR(b.axis.setpoint(), 50.0, 1e-9);
  b.run(252);
  EXPECT_EQ(b.axis.setpoint(), 0.0);
  EXPECT_TRUE(b.bit(10)) << "halted";
  EXPECT_EQ(b.axis.state(), DriveState::operation_enabled);
  b.command(0x0F, 100);
  EXPECT_GT(b.axis.setpoint(), 9.0);
}

TEST(EmulatedAxis, RampsStartFromTheSpeedThatTheWheelHas) {
  Bench b;
  b.wheel_follows = false;
  b.command(0x06);
  b.command(0x07);
  b.s.actual = 40.0;
  b.command(0x0F);
  EXPECT_NEAR(b.axis.setpoint(), 40.0, 0.2 + 1e-9);
}

// ---------------------------------------------------------------------------- quick stop

TEST(EmulatedAxis, QuickStopOption2RampsAt6085ThenSwitchesOff) {
  Bench b;
  b.enable_at(100.0);
  b.s.quick_stop_option = 2;
  b.command(0x02, 99);
  EXPECT_EQ(b.axis.state(), DriveState::quick_stop_active);
  EXPECT_EQ(b.axis.statusword() & 0x6F, 0x07);
  EXPECT_NEAR(b.axis.setpoint(), 1.0, 1e-9);
  b.run(3);
  EXPECT_EQ(b.axis.state(), DriveState::switch_on_disabled);
}

TEST(EmulatedAxis, QuickStopOption6RampsAt6085AndStays) {
  Bench b;
  b.enable_at(100.0);
  b.s.quick_stop_option = 6;
  b.command(0x02, 1000);
  EXPECT_EQ(b.axis.state(), DriveState::quick_stop_active);
  EXPECT_EQ(b.axis.setpoint(), 0.0);
  EXPECT_TRUE(b.bit(10)) << "quick stop finished";
  EXPECT_EQ(b.command(0x0F), DriveState::operation_enabled);
}

TEST(EmulatedAxis, QuickStopOptions1And5UseTheProfileDeceleration) {
  for (const int option : {1, 5}) {
    Bench b;
    b.enable_at(100.0);
    b.s.quick_stop_option = option;
    b.command(0x02, 250);
    EXPECT_NEAR(b.axis.setpoint(), 50.0, 1e-9) << option;
    b.run(253);
    EXPECT_EQ(b.axis.state(),
              option == 1 ? DriveState::switch_on_disabled : DriveState::quick_stop_active);
  }
}

TEST(EmulatedAxis, QuickStopOption0SwitchesOffAtOnce) {
  Bench b;
  b.enable_at(100.0);
  b.s.quick_stop_option = 0;
  EXPECT_EQ(b.command(0x02), DriveState::switch_on_disabled);
  EXPECT_EQ(b.axis.setpoint(), 0.0);
}

TEST(EmulatedAxis, DisableVoltageEndsAQuickStopAtOnce) {
  Bench b;
  b.enable_at(100.0);
  b.s.quick_stop_option = 6;
  b.command(0x02, 10);
  EXPECT_EQ(b.command(0x00), DriveState::switch_on_disabled);
}

TEST(EmulatedAxis, AQuickStopFromWithinIsNotUndoneByTheControlwordThatStandsThere) {
  Bench b;
  b.enable_at(100.0);
  b.s.quick_stop_option = 6;
  b.axis.quick_stop();
  b.run(200);
  EXPECT_EQ(b.axis.state(), DriveState::quick_stop_active);
  EXPECT_EQ(b.command(0x0F), DriveState::operation_enabled) << "a fresh command ends it";
}

TEST(EmulatedAxis, AQuickStopFromWithinSwitchesOffWhatIsNotEnabled) {
  Bench b;
  b.command(0x06);
  b.command(0x07);
  b.axis.quick_stop();
  EXPECT_EQ(b.axis.state(), DriveState::switch_on_disabled);
}

// ---------------------------------------------------------------------------- faults

TEST(EmulatedAxis, AFaultRampsAt6085BeforeFault) {
  Bench b;
  b.enable_at(100.0);
  b.axis.trip(0x7500);
  b.run(99);
  EXPECT_EQ(b.axis.state(), DriveState::fault_reaction);
  EXPECT_EQ(b.axis.statusword() & 0x4F, 0x0F);
  EXPECT_NEAR(b.axis.setpoint(), 1.0, 1e-9);
  b.run(3);
  EXPECT_EQ(b.axis.state(), DriveState::fault);
  EXPECT_EQ(b.axis.statusword() & 0x4F, 0x08);
  EXPECT_EQ(b.axis.error_code(), 0x7500);
}

TEST(EmulatedAxis, FaultReactionOption1UsesTheProfileDecelerationAnd0SwitchesOff) {
  Bench slow, off;
  slow.enable_at(100.0);
  slow.s.fault_reaction_option = 1;
  slow.axis.trip(1);
  slow.run(250);
  EXPECT_NEAR(slow.axis.setpoint(), 50.0, 1e-9);
  off.enable_at(100.0);
  off.s.fault_reaction_option = 0;
  off.axis.trip(1);
  off.run(1);
  EXPECT_EQ(off.axis.state(), DriveState::fault);
  EXPECT_EQ(off.axis.setpoint(), 0.0);
}

TEST(EmulatedAxis, AFaultWithoutPowerNeedsNoRamp) {
  Bench b;
  b.axis.trip(0x3210);
  EXPECT_EQ(b.axis.state(), DriveState::fault_reaction);
  b.run(1);
  EXPECT_EQ(b.axis.state(), DriveState::fault);
}

TEST(EmulatedAxis, OnlyARisingEdgeInFaultResets) {
  Bench b;
  b.command(0x80);  // the edge comes before the fault
  b.axis.trip(1);
  b.run(5);
  EXPECT_EQ(b.command(0x80, 5), DriveState::fault) << "held, no edge";
  EXPECT_EQ(b.command(0x00, 5), DriveState::fault);
  EXPECT_EQ(b.command(0x80), DriveState::switch_on_disabled);
  EXPECT_EQ(b.axis.error_code(), 0);
}

TEST(EmulatedAxis, AnEdgeDuringTheFaultReactionIsTooEarly) {
  Bench b;
  b.enable_at(100.0);
  b.axis.trip(1);
  b.run(10);
  b.command(0x80, 200);
  EXPECT_EQ(b.axis.state(), DriveState::fault);
}

TEST(EmulatedAxis, AnEdgeBetweenTwoTicksCounts) {
  Bench b;
  b.axis.trip(1);
  b.run(5);
  b.axis.write_control(0x80);
  b.axis.write_control(0x00);
  b.run(1);
  EXPECT_EQ(b.axis.state(), DriveState::switch_on_disabled);
}

TEST(EmulatedAxis, AfterAResetAHeldEnableMovesNothing) {
  Bench b;
  b.enable_at(100.0);
  b.axis.trip(1);
  b.run(200);
  b.command(0x80);
  EXPECT_EQ(b.command(0x0F, 50), DriveState::switch_on_disabled);
  EXPECT_EQ(b.axis.setpoint(), 0.0);
}

TEST(EmulatedAxis, TheFirstFaultKeepsItsCode) {
  Bench b;
  b.axis.trip(0x2310);
  b.axis.trip(0x7500);
  EXPECT_EQ(b.axis.error_code(), 0x2310);
}

}  // namespace
}  // namespace tether
