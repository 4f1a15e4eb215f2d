#include "can_bridge/emulated/safety_inputs.hpp"

#include <gtest/gtest.h>

namespace tether {
namespace {

using std::chrono::milliseconds;
using Act = EmulatedSafetyInputs::Act;

SafetyInputConfig input(std::uint8_t byte, std::uint16_t timeout_ms) {
  SafetyInputConfig config;
  config.wiring = CanInputWiring{0x3A0, 2, byte, 0x03, 0x01, 0x02, timeout_ms};
  return config;
}

struct EmulatedSafetyInputsTest : ::testing::Test {
  EmulatedSafetyInputs inputs{{input(0, 100), input(1, 60)}};
  Instant now = kStart;
  /// All frames of so many milliseconds.
  std::vector<CanFrame> run(int ms) {
    std::vector<CanFrame> out;
    for (int i = 0; i < ms; ++i, now += milliseconds{1}) inputs.tick(now, out);
    return out;
  }
  CanFrame newest() { return run(20).back(); }
};

TEST_F(EmulatedSafetyInputsTest, AreClearAtAThirdOfTheShortestTimeout) {
  const auto frames = run(60);
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(frames[0], CanFrame::make(0x3A0, {0x01, 0x01}));
}

TEST_F(EmulatedSafetyInputsTest, EachDemandsForItself) {
  inputs.set(2, Act::demand);
  EXPECT_EQ(newest(), CanFrame::make(0x3A0, {0x01, 0x02}));
  inputs.set(0, Act::demand);
  EXPECT_EQ(newest(), CanFrame::make(0x3A0, {0x02, 0x02}));
  inputs.set(0, Act::clear);
  EXPECT_EQ(newest(), CanFrame::make(0x3A0, {0x01, 0x01}));
}

TEST_F(EmulatedSafetyInputsTest, FallSilentOrMakeNoSense) {
  inputs.set(1, Act::nonsense);
  EXPECT_EQ(newest().size, 1);
  inputs.set(1, Act::silence);
  EXPECT_TRUE(run(200).empty());
}

TEST_F(EmulatedSafetyInputsTest, AreNumberedFromOne) {
  EXPECT_TRUE(inputs.has(0));
  EXPECT_TRUE(inputs.has(2));
  EXPECT_FALSE(inputs.has(3));
  EXPECT_FALSE(inputs.has(-1));
}

}  // namespace
}  // namespace tether
