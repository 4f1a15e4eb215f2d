#include "common/vehicle/frames.hpp"

#include <gtest/gtest.h>

#include <array>
#include <numbers>

namespace tether {
namespace {

TEST(Frames, RelativePosesUndoCompose) {
  const std::array<std::array<Pose2, 2>, 2> pairs{
      {{{{1.0, -2.0, 3.0}, {0.5, 0.25, 1.0}}}, {{{1.0, -2.0, 2.5}, {0.3, 0.7, 1.9}}}}};
  for (const auto& [a, b] : pairs) {
    const Pose2 back = relative_to(a, compose(a, b));
    EXPECT_NEAR(back.x_m, b.x_m, 1e-12);
    EXPECT_NEAR(back.y_m, b.y_m, 1e-12);
    EXPECT_NEAR(back.yaw_rad, b.yaw_rad, 1e-12);
  }
}

TEST(Frames, AQuarterOfACircleEndsAtItsSide) {
  const double radius_m = 2.0, quarter_rad = std::numbers::pi / 2;
  const Pose2 end = along_arc({1.0, 0.0, 0.0}, radius_m * quarter_rad, quarter_rad);
  EXPECT_NEAR(end.x_m, 3.0, 1e-12);
  EXPECT_NEAR(end.y_m, 2.0, 1e-12);
  EXPECT_NEAR(end.yaw_rad, quarter_rad, 1e-12);
}

TEST(Frames, AnArcWithoutATurnIsStraightAndOneWithoutAWayTurnsOnTheSpot) {
  EXPECT_EQ(along_arc({}, 1.5, 0.0).x_m, 1.5);
  const Pose2 turned = along_arc({1.0, 2.0, 0.0}, 0.0, 0.7);
  EXPECT_EQ(turned.x_m, 1.0);
  EXPECT_EQ(turned.y_m, 2.0);
  EXPECT_EQ(turned.yaw_rad, 0.7);
}

}  // namespace
}  // namespace tether
