#include "netem/models/indoor_factory.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace tether {
namespace {

using Clutter = IndoorFactory::Clutter;

// Manual calculation: 31.84 + 21.5 lg 20 + 19 lg 3.5 and 33.63 + 21.9 lg 20 + 20 lg 3.5; heights
// are equal.
TEST(IndoorFactory, LosesWhatTheTableSays) {
  IndoorFactory hall = IndoorFactory::of(Clutter::dense_high, 3.5);
  hall.station_height_m = hall.vehicle_height_m;
  EXPECT_NEAR(hall.path_loss_db(20.0, true), 70.15, 0.01);
  EXPECT_NEAR(hall.path_loss_db(20.0, false), 73.00, 0.01);
}

TEST(IndoorFactory, IsNeverHeardBetterWithoutALineOfSight) {
  for (const Clutter clutter :
       {Clutter::sparse_low, Clutter::dense_low, Clutter::sparse_high, Clutter::dense_high}) {
    const IndoorFactory hall = IndoorFactory::of(clutter, 5.5);
    for (double d = 0.0; d < 200.0; d += 0.7) {
      EXPECT_GE(hall.path_loss_db(d, false), hall.path_loss_db(d, true));
    }
  }
}

/// Whether a vehicle at the origin sees a station at (distance, 0): squares of the clutter's size
/// and height stand on the floor at random, as many as cover the share that is its density.
bool sees(const IndoorFactory& hall, double distance_m, RandomEngine& random) {
  const double a = hall.clutter_size_m;
  const double per_m2 = -std::log1p(-hall.clutter_density) / (a * a);
  const double length_m = distance_m + 2 * a, width_m = 3 * a;
  // A Poisson process along the strip: exponential steps in x, uniform in y.
  double x_m = -a;
  bool clear = true;
  for (;;) {
    x_m -= std::log1p(-uniform_01(random)) / (per_m2 * width_m);
    if (x_m > length_m - a) return clear;
    const double y_m = (uniform_01(random) - 0.5) * width_m;
    if (std::abs(y_m) > a / 2 || x_m < -a / 2 || x_m - a / 2 > distance_m) continue;
    const double into_m = x_m - a / 2;  // where the line comes to it
    if (into_m < 0.0) continue;         // the vehicle stands there itself: such halls do not count
    const double line_m = hall.vehicle_height_m +
                          (hall.station_height_m - hall.vehicle_height_m) * into_m / distance_m;
    clear &= line_m > hall.clutter_height_m;
  }
}

// Apart from objects on the vehicle, a line over squares that stand at random with the density r is
// clear with exp(-d/k), and k is the table's: 4000 halls, four standard errors.
TEST(IndoorFactory, SeesAsFarAsBetweenRandomSquares) {
  for (const Clutter clutter :
       {Clutter::sparse_low, Clutter::dense_low, Clutter::sparse_high, Clutter::dense_high}) {
    const IndoorFactory hall = IndoorFactory::of(clutter, 5.5);
    RandomEngine random(1);
    for (const double distance_m : {10.0, 25.0, 60.0}) {
      constexpr int kHalls = 4000;
      int clear = 0;
      for (int i = 0; i < kHalls; ++i) clear += sees(hall, distance_m, random) ? 1 : 0;
      const double p = hall.los_probability(distance_m);
      EXPECT_NEAR(static_cast<double>(clear) / kHalls, p, 4 * std::sqrt(p * (1 - p) / kHalls))
          << distance_m << " m, clutter " << static_cast<int>(clutter);
    }
  }
}

// 300 halls, one place each: four standard errors. The same place is asked twice.
TEST(IndoorFactoryMap, SeesPlacesWithTheirProbabilityAndAlwaysTheSame) {
  const IndoorFactory hall = IndoorFactory::of(Clutter::sparse_low, 5.5);
  constexpr int kHalls = 300;
  RandomEngine random(7);
  int seen = 0;
  double sum_db = 0.0, squares_db2 = 0.0;
  for (int i = 0; i < kHalls; ++i) {
    const IndoorFactoryMap map(hall, 3.0, 4.0, random);
    const bool sees = map.line_of_sight(33.0, 44.0);
    EXPECT_EQ(sees, map.line_of_sight(33.0, 44.0));
    seen += sees ? 1 : 0;
    const double off_db =
        (map.path_loss_db(33.0, 44.0) - hall.path_loss_db(50.0, sees)) / hall.shadowing_sd_db(sees);
    sum_db += off_db;
    squares_db2 += off_db * off_db;
  }
  const double p = hall.los_probability(50.0);
  EXPECT_NEAR(static_cast<double>(seen) / kHalls, p, 4 * std::sqrt(p * (1 - p) / kHalls));
  EXPECT_NEAR(sum_db / kHalls, 0.0, 4 / std::sqrt(kHalls));
  EXPECT_NEAR(squares_db2 / kHalls, 1.0, 4 * std::sqrt(2.0 / kHalls));
}

}  // namespace
}  // namespace tether
