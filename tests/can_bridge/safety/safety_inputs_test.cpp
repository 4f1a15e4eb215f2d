#include "can_bridge/safety/safety_inputs.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace tether {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using ::testing::HasSubstr;
using Function = SafetyInputConfig::Function;

constexpr std::uint32_t kId = 0x3A0;
constexpr std::uint8_t kClear = 0x01, kStop = 0x02;
constexpr milliseconds kTimeout{100};

/// Two antivalent bits in the second of two bytes.
SafetyInputConfig on_can(Function function = Function::protective_stop) {
  SafetyInputConfig config;
  config.name = "field";
  config.function = function;
  config.speed_limit_mps = 0.3;
  config.wiring = SafetyInputConfig::Can{kId, 2, 1, 0x03, kClear, kStop, kTimeout.count()};
  return config;
}

SafetyInputConfig on_gpio(Function function = Function::protective_stop) {
  SafetyInputConfig config = on_can(function);
  config.wiring = SafetyInputConfig::Gpio{"gpiochip0", 17, false};
  return config;
}

struct SafetyInputsTest : ::testing::Test {
  Instant now = kStart + std::chrono::seconds{100};
  SafetyInputs inputs{{on_can()}};

  void use(std::vector<SafetyInputConfig> configs) { inputs = SafetyInputs(std::move(configs)); }
  void say(std::uint8_t bits) { inputs.on_frame(CanFrame::make(kId, {0xAA, bits}), now); }
  SafetyDemands demands() { return inputs.cycle(now); }
  SafetyDemands after(Duration d, std::uint8_t bits) {
    now += d;
    say(bits);
    return demands();
  }
  std::int64_t counter(const std::string& name) const {
    CounterList all;
    inputs.list(all);
    for (const auto& [key, value] : all) {
      if (key == name) return value;
    }
    ADD_FAILURE() << "no counter " << name;
    return -1;
  }
};

TEST_F(SafetyInputsTest, WithoutInputsNothingIsDemanded) {
  use({});
  EXPECT_EQ(demands().stop, "");
  EXPECT_EQ(demands().estop, "");
  EXPECT_FALSE(demands().speed_limit_mps);
  EXPECT_FALSE(demands().ramp);
}

TEST_F(SafetyInputsTest, OneThatWasNeverHeardMeansStop) {
  EXPECT_THAT(demands().stop, HasSubstr("safety input field: no frame 0x3A0 for 100 ms"));
  say(kClear);
  EXPECT_EQ(demands().stop, "");
}

TEST_F(SafetyInputsTest, OnlyTheClearBitsAreClear) {
  say(kClear | 0xF0);  // other bits do not matter
  EXPECT_EQ(demands().stop, "");
  say(kStop);
  const SafetyDemands d = demands();
  EXPECT_EQ(d.stop, "safety input field demands a stop");
  EXPECT_FALSE(d.ramp);
  EXPECT_FALSE(d.may_resume);
}

TEST_F(SafetyInputsTest, BitsThatContradictEachOtherMakeNoSense) {
  for (const std::uint8_t bits : {0x00, 0x03}) {
    say(bits);
    EXPECT_THAT(demands().stop, HasSubstr("frame 0x3A0 says")) << int{bits};
  }
  EXPECT_EQ(counter("input.field.nonsense"), 1) << "it began once";
}

TEST_F(SafetyInputsTest, WithoutAStopValueWhateverIsNotClearIsADemand) {
  SafetyInputConfig config = on_can();
  std::get<SafetyInputConfig::Can>(config.wiring).stop.reset();
  use({config});
  for (const std::uint8_t bits : {0x00, 0x02, 0x03}) {
    say(bits);
    EXPECT_EQ(demands().stop, "safety input field demands a stop");
  }
}

TEST_F(SafetyInputsTest, AFrameOfAnotherLengthMakesNoSense) {
  say(kClear);
  inputs.on_frame(CanFrame::make(kId, {0xAA}), now);
  EXPECT_EQ(demands().stop, "safety input field: frame 0x3A0 has 1 bytes, not 2");
  inputs.on_frame(CanFrame::make(kId, {0xAA, kClear, 0}), now);
  EXPECT_THAT(demands().stop, HasSubstr("has 3 bytes"));
}

TEST_F(SafetyInputsTest, FramesOfOthersExtendedAndRemoteOnesAreNotHeard) {
  CanFrame other = CanFrame::make(kId + 1, {0, kClear});
  CanFrame extended = CanFrame::make(kId, {0, kClear}), remote = extended;
  extended.extended = true;
  remote.remote = true;
  for (const CanFrame& frame : {other, extended, remote}) {
    EXPECT_FALSE(inputs.on_frame(frame, now));
    EXPECT_NE(demands().stop, "");
  }
}

TEST_F(SafetyInputsTest, SilenceMeansStopFromItsTimeoutOn) {
  say(kClear);
  now += kTimeout - nanoseconds{1};
  EXPECT_EQ(demands().stop, "");
  now += nanoseconds{1};
  EXPECT_THAT(demands().stop, HasSubstr("no frame 0x3A0 for 100 ms"));
  EXPECT_EQ(counter("input.field.silences"), 1);
  EXPECT_EQ(counter("input.field.nonsense"), 0);
  say(kClear);
  EXPECT_EQ(demands().stop, "");
}

TEST_F(SafetyInputsTest, ADemandBetweenTwoCyclesCountsInTheNext) {
  say(kClear);
  ASSERT_EQ(demands().stop, "");
  say(kStop);
  say(kClear);
  EXPECT_EQ(demands().stop, "safety input field demands a stop");
  EXPECT_EQ(demands().stop, "");
  EXPECT_EQ(counter("input.field.demands"), 1);
}

TEST_F(SafetyInputsTest, ARampIsDemandedOnlyIfAllThatDemandAStopAreContentWithIt) {
  SafetyInputConfig ramp = on_can();
  ramp.reaction = SafetyInputConfig::Reaction::ramp;
  SafetyInputConfig quick = on_gpio();
  use({ramp, quick});
  inputs.on_level(1, true);
  say(kStop);
  EXPECT_TRUE(demands().ramp);
  inputs.on_level(1, false);
  EXPECT_FALSE(demands().ramp);
  say(kClear);
  EXPECT_FALSE(demands().ramp);
  use({quick, ramp});
  inputs.on_level(0, false);
  say(kStop);
  EXPECT_FALSE(demands().ramp);
  EXPECT_EQ(demands().stop, "safety input field demands a stop; safety input field demands a stop");
}

TEST_F(SafetyInputsTest, OneThatMayRestartIsClearAfterItsTimeAndNotATickBefore) {
  SafetyInputConfig config = on_can();
  config.restart_after_s = 2.0;
  use({config});
  say(kStop);
  SafetyDemands d = demands();
  EXPECT_TRUE(d.may_resume);
  EXPECT_TRUE(d.ramp);
  after(milliseconds{20}, kClear);  // clear from here on
  for (int i = 0; i < 99; ++i) d = after(milliseconds{20}, kClear);
  EXPECT_EQ(d.stop, "safety input field has been clear for 1.9 s, not yet for 2 s");
  d = after(milliseconds{20} - nanoseconds{1}, kClear);
  EXPECT_TRUE(d.may_resume);
  EXPECT_EQ(after(nanoseconds{1}, kClear).stop, "");
}

TEST_F(SafetyInputsTest, ADemandInBetweenBeginsThatTimeAgain) {
  SafetyInputConfig config = on_can();
  config.restart_after_s = 2.0;
  use({config});
  for (int i = 0; i < 90; ++i) after(milliseconds{20}, kClear);
  after(milliseconds{20}, kStop);
  after(milliseconds{20}, kClear);
  for (int i = 0; i < 99; ++i) EXPECT_NE(after(milliseconds{20}, kClear).stop, "");
  EXPECT_EQ(after(milliseconds{20}, kClear).stop, "");
}

TEST_F(SafetyInputsTest, FromSilenceAndNonsenseNothingRestarts) {
  SafetyInputConfig config = on_can();
  config.restart_after_s = 2.0;
  use({config});
  say(0x03);
  EXPECT_FALSE(demands().may_resume);
  now += kTimeout;
  EXPECT_FALSE(demands().may_resume);
  EXPECT_FALSE(demands().ramp);
}

TEST_F(SafetyInputsTest, NothingRestartsWhileAnotherInputThatMayNotDemandsAStop) {
  SafetyInputConfig restarts = on_can();
  restarts.restart_after_s = 2.0;
  use({restarts, on_gpio()});
  say(kStop);
  inputs.on_level(1, false);
  EXPECT_FALSE(demands().may_resume);
  use({on_gpio(), restarts});
  inputs.on_level(0, false);
  say(kStop);
  EXPECT_FALSE(demands().may_resume);
}

TEST_F(SafetyInputsTest, TheLowestOfTheDemandedLimitsHolds) {
  SafetyInputConfig slow = on_gpio(Function::speed_limit);
  slow.name = "rear";
  slow.speed_limit_mps = 0.1;
  use({on_can(Function::speed_limit), slow});
  inputs.on_level(1, true);
  say(kClear);
  EXPECT_FALSE(demands().speed_limit_mps);
  say(kStop);
  EXPECT_EQ(demands().speed_limit_mps, 0.3);
  EXPECT_EQ(demands().speed_limit_by, "safety input field");
  inputs.on_level(1, false);
  EXPECT_EQ(demands().speed_limit_mps, 0.1);
  EXPECT_EQ(demands().speed_limit_by, "safety input rear");
  EXPECT_EQ(demands().stop, "");
  use({slow, on_can(Function::speed_limit)});
  inputs.on_level(0, false);
  say(kStop);
  EXPECT_EQ(demands().speed_limit_mps, 0.1);
}

TEST_F(SafetyInputsTest, ASpeedLimitThatIsSilentMeansStop) {
  use({on_can(Function::speed_limit)});
  say(kClear);
  now += kTimeout;
  EXPECT_NE(demands().stop, "");
  EXPECT_FALSE(demands().may_resume);
}

TEST_F(SafetyInputsTest, AnEStopContactIsPressedUnlessItSaysClear) {
  use({on_can(Function::estop_status)});
  say(kClear);
  EXPECT_EQ(demands().estop, "");
  now += kTimeout;
  EXPECT_THAT(demands().estop, HasSubstr("no frame"));
  say(kStop);
  EXPECT_EQ(demands().estop, "safety input field: e-stop pressed");
  EXPECT_EQ(demands().stop, "");
  say(0x03);
  EXPECT_NE(demands().estop, "");
  say(kClear);
  demands();
  EXPECT_EQ(demands().estop, "");
}

TEST_F(SafetyInputsTest, AnEStopContactThatWasNeverHeardDemandsAStopAndLatchesNothing) {
  use({on_can(Function::estop_status)});
  EXPECT_EQ(demands().estop, "");
  EXPECT_THAT(demands().stop, HasSubstr("no frame"));
  EXPECT_FALSE(demands().may_resume);
  use({on_gpio(Function::estop_status)});
  inputs.on_level(0, std::nullopt);
  EXPECT_EQ(demands().estop, "");
  inputs.on_level(0, true);
  demands();
  inputs.on_level(0, std::nullopt);
  EXPECT_THAT(demands().estop, HasSubstr("cannot be read"));
}

TEST_F(SafetyInputsTest, ALineThatCannotBeReadMeansStop) {
  use({on_gpio()});
  EXPECT_EQ(demands().stop, "safety input field: line 17 of gpiochip0 cannot be read");
  inputs.on_level(0, true);
  EXPECT_EQ(demands().stop, "");
  inputs.on_level(0, std::nullopt);
  EXPECT_EQ(demands().stop, "safety input field: line 17 of gpiochip0 cannot be read");
  EXPECT_EQ(counter("input.field.silences"), 1);
  inputs.on_level(0, false);
  demands();
  EXPECT_EQ(demands().stop, "safety input field demands a stop");
}

TEST_F(SafetyInputsTest, OneFrameMayCarrySeveralInputs) {
  SafetyInputConfig warning = on_can(Function::speed_limit);
  auto& can = std::get<SafetyInputConfig::Can>(warning.wiring);
  can.byte = 0;
  can.mask = can.clear = 0x80;
  can.stop.reset();
  use({on_can(), warning});
  inputs.on_frame(CanFrame::make(kId, {0x00, kClear}), now);
  EXPECT_EQ(demands().stop, "");
  EXPECT_EQ(demands().speed_limit_mps, 0.3);
}

}  // namespace
}  // namespace tether
