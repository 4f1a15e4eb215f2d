#include "can_bridge/agilex/v2.hpp"

#include <gmock/gmock.h>

#include <cstdint>

#include "can_bridge/agilex/v2_profile.hpp"
#include "common/base/errors.hpp"
#include "tests/can_bridge/agilex/v2_rig.hpp"

namespace tether {
namespace {

using agilex::Condition;
using agilex::Mode;

TEST(AgilexFrames, MotionCommandIsBigEndianInMillimetresAndMilliradians) {
  // The manual's example: 0.15 m/s forward is 0x0096.
  EXPECT_EQ(agilex::encode(0x111, agilex::Motion{150, 0}),
            CanFrame::make(0x111, {0x00, 0x96, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(agilex::encode(0x111, agilex::Motion{-2, 785}),
            CanFrame::make(0x111, {0xFF, 0xFE, 0x03, 0x11, 0, 0, 0, 0}));
}

TEST(AgilexFrames, SystemStateReadsByteByByte) {
  const auto state =
      agilex::decode_system_state(CanFrame::make(0x211, {2, 1, 0x00, 0xF7, 0x01, 0x02, 0, 9}));
  ASSERT_TRUE(state);
  EXPECT_EQ(state->condition, Condition::exception);
  EXPECT_EQ(state->mode, Mode::can);
  EXPECT_DOUBLE_EQ(state->battery_V, 24.7);
  EXPECT_EQ(state->error_code, 0x0102);
  EXPECT_EQ(state->count, 9);
}

TEST(AgilexFrames, OdometryIsTwoSignedNumbersOf32Bits) {
  const CanFrame frame = CanFrame::make(0x311, {0xFF, 0xFF, 0xFF, 0xFE, 0x00, 0x01, 0x00, 0x02});
  EXPECT_EQ(agilex::decode_odometry(frame), (agilex::Odometry{-2, 65538}));
  EXPECT_EQ(agilex::encode(agilex::Odometry{-2, 65538}), frame);
}

TEST(AgilexFrames, MotorStateCarriesSpeedCurrentAndPulses) {
  const CanFrame frame = CanFrame::make(0x252, {0xFF, 0x9C, 0x00, 0x15, 0x80, 0x00, 0x00, 0x00});
  EXPECT_EQ(agilex::decode_motor(frame), (agilex::MotorState{-100, 21, INT32_MIN}));
  EXPECT_EQ(agilex::encode(0x252, agilex::MotorState{-100, 21, INT32_MIN}), frame);
}

TEST(AgilexFrames, WrongLengthsAndUnknownStatesAreRefused) {
  EXPECT_FALSE(agilex::decode_system_state(CanFrame::make(0x211, {0, 1, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(agilex::decode_system_state(CanFrame::make(0x211, {3, 1, 0, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(agilex::decode_system_state(CanFrame::make(0x211, {0, 4, 0, 0, 0, 0, 0, 0})));
  EXPECT_FALSE(agilex::decode_motion(CanFrame::make(0x221, {0, 1, 0, 0})));
  EXPECT_FALSE(agilex::decode_odometry(CanFrame::make(0x311, {0, 1, 0, 0})));
  EXPECT_FALSE(agilex::decode_motor(CanFrame::make(0x251, {})));
}

TEST(AgilexProfile, AVehicleOfOtherDimensionsIsRefused) {
  using test::agilex_chassis;
  using test::kRadius_m;
  using test::kTrack_m;
  EXPECT_NO_THROW(AgilexV2Profile(agilex_chassis(), kRadius_m * 1.009, kTrack_m));
  EXPECT_THROW(AgilexV2Profile(agilex_chassis(), kRadius_m * 1.011, kTrack_m), UsageError);
  EXPECT_THROW(AgilexV2Profile(agilex_chassis(), kRadius_m, kTrack_m * 0.989), UsageError);
}

}  // namespace
}  // namespace tether
