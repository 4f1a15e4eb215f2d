#include <gtest/gtest.h>

#include "onboard/localiser/scan_match.hpp"
#include "tests/localiser/hall.hpp"

namespace tether {
namespace {

using test::HallScanner;
using test::walls;

/// Drives along a circle of 2 m at 2 m/s, 1 rad/s.
Pose2 on_circle(Instant when) {
  const double t_s = to_seconds(when);
  return {2.0 * std::sin(t_s), 2.0 - 2.0 * std::cos(t_s), wrap_angle(t_s)};
}

OdometryTrack odometry_of_circle() {
  OdometryTrack track;
  for (int i = 0; i <= 50; ++i) {
    const Instant when = kStart + std::chrono::milliseconds{20 * i};
    track.add({when, on_circle(when), 0.04 * i, {2.0, 1.0}});
  }
  return track;
}

TEST(Beams, OfAMovingScannerEndOnTheWallsSeenFromWhereItWasInTheMiddle) {
  const std::vector<Shape> shapes = walls(12.0, 10.0);
  HallScanner scanner;
  scanner.noise_m = 0.0;
  RandomEngine random = random_stream(1, "scan");
  const Scan scan = scanner.measure(shapes, kStart + from_seconds(0.5), 0, on_circle, random);
  const auto farthest_m = [&](const std::vector<Beam>& beams) {
    double farthest = 0.0;
    for (const Beam& beam : beams) {
      const Pose2 end = compose(on_circle(middle(scan)), {beam.x_m, beam.y_m, 0.0});
      double off_m = 1e9;
      for (const Shape& wall : shapes) {
        off_m = std::min(off_m, std::abs(distance_m(wall, {end.x_m, end.y_m})));
      }
      farthest = std::max(farthest, off_m);
    }
    return farthest;
  };
  // A chord of 20 ms instead of an arc: 1 rad/s · 2 m/s · (20 ms)²/8 = 0.1 mm.
  EXPECT_LT(farthest_m(beams_of(scan, odometry_of_circle(), middle(scan), 1000)), 5e-4);
  EXPECT_GT(farthest_m(beams_of(scan, {}, kStart, 1000)),
            0.1);  // distorted, if the motion is not known
}

TEST(Beams, LeavesOutWhatDidNotComeBackAndChoosesEvenly) {
  HallScanner scanner;
  Scan scan = scanner.empty_scan(kStart, 0);
  scan.range_m.assign(541, 1.0F);
  scan.range_m[0] = 0.0F;
  scan.range_m[540] = 100.0F;
  EXPECT_EQ(beams_of(scan, {}, kStart, 1000).size(), 539U);
  const std::vector<Beam> some = beams_of(scan, {}, kStart, 54);
  EXPECT_EQ(some.size(), 53U);
  for (const Beam& beam : some) {
    EXPECT_NEAR(std::hypot(beam.x_m - scanner.mount.x_m, beam.y_m), 1.0, 1e-5);
  }
}

TEST(Beams, PointFromTheScannerWhereverItIsMounted) {
  HallScanner scanner;
  scanner.mount = {0.5, -0.2, 0.5 * std::numbers::pi};
  Scan scan = scanner.empty_scan(kStart, 0);
  scan.range_m.assign(541, 0.0F);
  scan.range_m[270] = 2.0F;  // straight ahead of the scanner, left of the vehicle
  const std::vector<Beam> beams = beams_of(scan, {}, kStart, 1000);
  ASSERT_EQ(beams.size(), 1U);
  EXPECT_NEAR(beams[0].x_m, 0.5, 1e-6);
  EXPECT_NEAR(beams[0].y_m, 1.8, 1e-6);
  EXPECT_NEAR(beams[0].along_y, 1.0, 1e-6);
}

}  // namespace
}  // namespace tether
