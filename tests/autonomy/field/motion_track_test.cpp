#include <gtest/gtest.h>

#include "onboard/autonomy/obstacle_field.hpp"
#include "onboard/autonomy/swept_way.hpp"

namespace tether {
namespace {

Instant at_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

class MotionTrackTest : public ::testing::Test {
 protected:
  MotionTrackTest() {
    for (int i = 0; i <= 50; ++i) {
      track_.add(at_ms(20 * i), moved({}, kTwist, 0.02 * i), kTwist);
    }
  }
  static constexpr Twist kTwist{1.2, 0.4};
  MotionTrack track_;
};

TEST_F(MotionTrackTest, KnowsWhereItWasBetweenTwoMessages) {
  const Pose2 expected = moved({}, kTwist, 0.51);
  const std::optional<Pose2> pose = track_.at(at_ms(510));
  ASSERT_TRUE(pose);
  EXPECT_NEAR(pose->x_m, expected.x_m, 1e-4);
  EXPECT_NEAR(pose->y_m, expected.y_m, 1e-4);
  EXPECT_NEAR(pose->yaw_rad, expected.yaw_rad, 1e-9);
}

TEST_F(MotionTrackTest, GoesOnByTheNewestTwistForAShortTimeOnly) {
  const Pose2 expected = moved({}, kTwist, 1.2);
  const std::optional<Pose2> pose = track_.at(at_ms(1200));
  ASSERT_TRUE(pose);
  EXPECT_NEAR(pose->x_m, expected.x_m, 1e-9);
  EXPECT_FALSE(track_.at(at_ms(1201)));
  EXPECT_FALSE(track_.twist(at_ms(1201)));
}

TEST_F(MotionTrackTest, DoesNotKnowWhatWasBeforeItsFirstMessage) {
  EXPECT_FALSE(track_.at(at_ms(-1)));
}

TEST_F(MotionTrackTest, MovesAPoseOnFromWhenItWasMeasured) {
  const Pose2 measured{10.0, 5.0, 1.0};
  const std::optional<Pose2> now = track_.moved_on(measured, at_ms(400), at_ms(1000));
  const Pose2 expected = moved(measured, kTwist, 0.6);
  ASSERT_TRUE(now);
  EXPECT_NEAR(now->x_m, expected.x_m, 1e-9);
  EXPECT_NEAR(now->y_m, expected.y_m, 1e-9);
  EXPECT_NEAR(now->yaw_rad, expected.yaw_rad, 1e-9);
}

}  // namespace
}  // namespace tether
