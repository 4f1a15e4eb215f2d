// The bound, against derivatives of ranges that are cast, and against closed forms.
#include "onboard/localiser/censi.hpp"

#include <gtest/gtest.h>

#include "tests/localiser/hall.hpp"

namespace tether {
namespace {

using test::cast;
using test::cylinder;
using test::hall;
using test::HallScanner;
using test::walls;

TEST(Censi, IsTheInformationOfDerivativesOfTheRanges) {
  const std::vector<Shape> shapes = hall();
  HallScanner scanner;
  scanner.beams = 101;
  const Pose2 pose{4.3, -1.7, 0.7};
  const Scan scan = scanner.empty_scan(kStart, 0);
  PoseInformation expected;
  const auto range_m = [&](const Pose2& at, std::size_t beam) {
    const Pose2 from = compose(at, scanner.mount);
    return cast(shapes, {from.x_m, from.y_m}, from.yaw_rad + scan.angle_rad(beam)).range_m;
  };
  constexpr double kStep = 1e-6;
  for (std::size_t i = 0; i < 101; ++i) {
    const auto slope = [&](const Pose2& step) {
      const Pose2 a{pose.x_m + step.x_m, pose.y_m + step.y_m, pose.yaw_rad + step.yaw_rad};
      const Pose2 b{pose.x_m - step.x_m, pose.y_m - step.y_m, pose.yaw_rad - step.yaw_rad};
      return (range_m(a, i) - range_m(b, i)) / (2.0 * kStep);
    };
    expected.add(slope({kStep, 0, 0}), slope({0, kStep, 0}), slope({0, 0, kStep}),
                 1.0 / (scanner.noise_m * scanner.noise_m));
  }
  const PoseInformation bound = scanner.bound(shapes, pose);
  const double tolerance = 1e-4;
  EXPECT_NEAR(bound.x_x / expected.x_x, 1.0, tolerance);
  EXPECT_NEAR(bound.y_y / expected.y_y, 1.0, tolerance);
  EXPECT_NEAR(bound.yaw_yaw / expected.yaw_yaw, 1.0, tolerance);
  EXPECT_NEAR(bound.x_yaw, expected.x_yaw, tolerance * expected.yaw_yaw);
  EXPECT_NEAR(bound.y_yaw, expected.y_yaw, tolerance * expected.yaw_yaw);
  EXPECT_NEAR(bound.x_y, expected.x_y, tolerance * expected.x_x);
}

TEST(Censi, SaysNothingAlongACorridor) {
  const std::vector<SeenOutline> beams{{1.0, 2.0, 0.5 * std::numbers::pi},
                                       {-1.2, 2.0, -0.5 * std::numbers::pi},
                                       {2.0, 3.0, 0.5 * std::numbers::pi}};
  const Weakness weak = weakness(censi_information(beams, 0.02));
  EXPECT_NEAR(weak.direction_rad, 0.0, 1e-6);
  EXPECT_EQ(weak.sigma_m, Weakness::kNothing);
  EXPECT_LT(weak.yaw_sigma_rad, 0.1);
}

TEST(Censi, SaysNothingOfTheYawInTheMiddleOfACircle) {
  std::vector<SeenOutline> beams;
  for (int i = 0; i < 60; ++i) beams.push_back({0.1 * i, 5.0, 0.1 * i});
  const Weakness weak = weakness(censi_information(beams, 0.02));
  EXPECT_LT(weak.sigma_m, 0.01);
  EXPECT_EQ(weak.yaw_sigma_rad, Weakness::kNothing);
}

}  // namespace
}  // namespace tether
