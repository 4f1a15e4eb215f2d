#include "onboard/localiser/distance_field.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <boost/random/uniform_int_distribution.hpp>
#include <cmath>

#include "common/base/errors.hpp"
#include "tests/localiser/hall.hpp"

namespace tether {
namespace {

using test::box;
using test::cylinder;
using test::hall;

TEST(DistanceTransform, IsExactForAnySeeds) {
  RandomEngine random = random_stream(1, "seeds");
  for (const int seeds : {1, 2, 7, 40}) {
    constexpr int kWidth = 37, kHeight = 23;
    std::vector<std::uint8_t> grid(kWidth * kHeight);
    std::vector<std::pair<int, int>> at;
    for (int i = 0; i < seeds; ++i) {
      const int x = boost::random::uniform_int_distribution<int>(0, kWidth - 1)(random);
      const int y = boost::random::uniform_int_distribution<int>(0, kHeight - 1)(random);
      grid[static_cast<std::size_t>(y * kWidth + x)] = 1;
      at.emplace_back(x, y);
    }
    const std::vector<float> squared = squared_distances(grid, kWidth);
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        int nearest = kWidth * kWidth + kHeight * kHeight;
        for (const auto& [sx, sy] : at) {
          nearest = std::min(nearest, (x - sx) * (x - sx) + (y - sy) * (y - sy));
        }
        ASSERT_EQ(squared[static_cast<std::size_t>(y * kWidth + x)], static_cast<float>(nearest));
      }
    }
  }
}

TEST(DistanceTransform, WithoutSeedsIsInfinite) {
  for (const float squared : squared_distances(std::vector<std::uint8_t>(12), 4)) {
    EXPECT_TRUE(std::isinf(squared));
  }
}

double true_distance_m(const std::vector<Shape>& shapes, const Position& place) {
  double nearest = 1e9;
  for (const Shape& shape : shapes) nearest = std::min(nearest, distance_m(shape, place));
  return nearest;
}

TEST(DistanceField, AtAStraightOutlineIsExactWhateverItsAngle) {
  for (const double yaw_rad : {0.0, 0.3, 0.785, 1.3}) {
    const DistanceField field({box(1.234, -0.777, 4.0, 3.0, yaw_rad)}, 0.05);
    const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
    for (double off_m = -0.3; off_m <= 0.3; off_m += 0.01) {
      for (double along_m = -1.0; along_m <= 1.0; along_m += 0.037) {
        const double x_m = 1.234 + c * (2.0 + off_m) - s * along_m;
        const double y_m = -0.777 + s * (2.0 + off_m) + c * along_m;
        const auto value = field.at(static_cast<float>(x_m), static_cast<float>(y_m));
        ASSERT_NEAR(value.distance_m, off_m, 2e-6);
        ASSERT_NEAR(value.by_x, c, 1e-4);
        ASSERT_NEAR(value.by_y, s, 1e-4);
      }
    }
  }
}

TEST(DistanceField, OfACircleIsOffByWhatACellsChordIsOff) {
  // A linear function between nodes h apart is off by h²/8 times the curvature 1/R, in each
  // direction.
  constexpr double kCell_m = 0.05, kRadius_m = 0.3;
  const DistanceField field({cylinder(0.0, 0.0, kRadius_m)}, kCell_m);
  for (double angle_rad = 0.0; angle_rad < 6.28; angle_rad += 0.01) {
    const auto value = field.at(static_cast<float>(kRadius_m * std::cos(angle_rad)),
                                static_cast<float>(kRadius_m * std::sin(angle_rad)));
    EXPECT_NEAR(value.distance_m, 0.0, 2.0 * kCell_m * kCell_m / 8.0 / (kRadius_m - kCell_m));
  }
}

TEST(DistanceField, IsWithinACellEverywhereAndExactNearOutlines) {
  const std::vector<Shape> shapes = hall();
  constexpr double kCell_m = 0.1;
  const DistanceField field(shapes, kCell_m);
  RandomEngine random = random_stream(2, "places");
  int near = 0, far = 0;
  for (int i = 0; i < 20000; ++i) {
    const Position place{30.0 * (uniform_01(random) - 0.5), 20.0 * (uniform_01(random) - 0.5)};
    const double truth_m = true_distance_m(shapes, place);
    if (truth_m < 0.0) continue;
    const double found_m =
        field.at(static_cast<float>(place.x_m), static_cast<float>(place.y_m)).distance_m;
    const bool is_far = truth_m > DistanceField::kExact_m - 2.0 * kCell_m;
    ++(is_far ? far : near);
    // Near: what a ridge between outlines or a corner loses within a cell; far: a cell.
    EXPECT_NEAR(found_m, truth_m, is_far ? 1.5 * kCell_m : 0.5 * kCell_m);
  }
  EXPECT_GT(near, 1000);
  EXPECT_GT(far, 1000);
}

TEST(DistanceField, BeyondTheGridIsFarAndFlat) {
  const DistanceField field({box(0.0, 0.0, 1.0, 1.0)}, 0.05);
  for (const float x_m : {-100.0F, 100.0F, std::nanf("")}) {
    const auto value = field.at(x_m, 0.0F);
    EXPECT_EQ(value.distance_m, DistanceField::kFar_m);
    EXPECT_EQ(value.by_x, 0.0F);
    EXPECT_EQ(value.by_y, 0.0F);
  }
}

TEST(DistanceField, RefusesMoreCellsThanMemoryIsFor) {
  try {
    const DistanceField field({box(0.0, 0.0, 1000.0, 1000.0)}, 0.005);
    FAIL();
  } catch (const UsageError& error) {
    EXPECT_NE(std::string(error.what()).find("localiser.resolution_m = 0.005"), std::string::npos);
  }
}

}  // namespace
}  // namespace tether
