// The scan-to-map match against Censi's bound, which no unbiased estimate can beat.
#include "onboard/localiser/scan_match.hpp"

#include <gtest/gtest.h>

#include <array>
#include <boost/math/distributions/chi_squared.hpp>
#include <numbers>

#include "tests/localiser/hall.hpp"

namespace tether {
namespace {

using test::any_free_pose;
using test::box;
using test::cylinder;
using test::hall;
using test::HallScanner;
using test::is_free;

constexpr double kCell_m = 0.05;

using Error = std::array<double, 3>;

Error error_of(const Pose2& found, const Pose2& truth) {
  return {found.x_m - truth.x_m, found.y_m - truth.y_m, wrap_angle(found.yaw_rad - truth.yaw_rad)};
}

double nees(const Error& e, const PoseInformation& i) {
  return e[0] * e[0] * i.x_x + e[1] * e[1] * i.y_y + e[2] * e[2] * i.yaw_yaw +
         2.0 * (e[0] * e[1] * i.x_y + e[0] * e[2] * i.x_yaw + e[1] * e[2] * i.y_yaw);
}

Pose2 guess_near(const Pose2& truth, double sigma_m, double sigma_rad, RandomEngine& random) {
  boost::random::normal_distribution<double> normal;
  const double x_m = truth.x_m + sigma_m * normal(random);
  const double y_m = truth.y_m + sigma_m * normal(random);
  return {x_m, y_m, wrap_angle(truth.yaw_rad + sigma_rad * normal(random))};
}

/// Mean squares over many places: of errors, and what the bound says of them.
struct Statistics {
  Error squares{}, bound{};
  double mean_nees = 0.0;
};

Statistics statistics(int places, const std::vector<Shape>& map, const std::vector<Shape>& world) {
  const DistanceField field(map, kCell_m);
  const HallScanner scanner;
  RandomEngine random = random_stream(1, "places");
  Statistics s;
  for (int n = 0; n < places; ++n) {
    const Pose2 truth = any_free_pose(world, 30.0, 20.0, 0.7, random);
    const auto beams = beams_of(scanner.measure_standing(world, truth, random), {}, kStart, 1000);
    const Match match =
        match_scan(field, beams, guess_near(truth, 0.05, 0.01, random), MatchSettings{});
    const Error error = error_of(match.pose, truth);
    const PoseCovariance least = covariance_of(scanner.bound(map, truth));
    const Error bound{least.x_x, least.y_y, least.yaw_yaw};
    for (std::size_t k = 0; k < 3; ++k) {
      s.squares[k] += error[k] * error[k] / places;
      s.bound[k] += bound[k] / places;
    }
    s.mean_nees += nees(error, match.information) / places;
  }
  return s;
}

// A mean of n squares of normal errors has a relative standard deviation of √(2/n); the ratio of
// root mean squares half of that: 2.2 % of 1000. The bar is the bound's 1.2.
TEST(ScanMatch, InAHallThatIsAsMappedIsWithinOneFifthOfTheBound) {
  const Statistics s = statistics(1000, hall(), hall());
  for (std::size_t k = 0; k < 3; ++k) {
    const double ratio = std::sqrt(s.squares[k] / s.bound[k]);
    std::cout << "component " << k << ": RMS error " << std::sqrt(s.squares[k]) << ", " << ratio
              << " of the bound\n";
    EXPECT_LT(ratio, 1.2);
    EXPECT_GT(ratio, 1.0 - 3.0 * 0.022);  // no unbiased estimate is better
  }
}

TEST(ScanMatch, SaysHowSureItIs) {
  constexpr int kPlaces = 1000;
  const double sum = kPlaces * statistics(kPlaces, hall(), hall()).mean_nees;
  const boost::math::chi_squared all(3 * kPlaces);
  std::cout << "mean NEES " << sum / kPlaces << " of 3\n";
  EXPECT_LT(sum, quantile(all, 0.975));
  EXPECT_GT(sum, 0.8 * 3 * kPlaces);  // not much less sure than it could be
}

TEST(ScanMatch, IsNotLedAstrayByPeopleAndThingsThatAreNotMapped) {
  std::vector<Shape> world = hall();
  RandomEngine random = random_stream(7, "people");
  for (int n = 0; n < 15; ++n) {
    const Pose2 at = any_free_pose(hall(), 28.0, 18.0, 0.4, random);
    world.push_back(cylinder(at.x_m, at.y_m, 0.2 + 0.2 * uniform_01(random)));
  }
  const Statistics s = statistics(400, hall(), world);
  for (std::size_t k = 0; k < 3; ++k) {
    // The bound is that of all beams; fewer are left.
    EXPECT_LT(std::sqrt(s.squares[k] / s.bound[k]), 2.0) << k;
  }
}

TEST(ScanMatch, FindsItsWayFromHalfAMetreAndSixDegreesIfItMayLookFar) {
  const std::vector<Shape> map = hall();
  const DistanceField field(map, kCell_m);
  const HallScanner scanner;
  RandomEngine random = random_stream(3, "far");
  MatchSettings settings;
  settings.max_distance_m = 1.5;
  int found = 0;
  constexpr int kPlaces = 200;
  for (int n = 0; n < kPlaces; ++n) {
    const Pose2 truth = any_free_pose(map, 30.0, 20.0, 0.7, random);
    const auto beams = beams_of(scanner.measure_standing(map, truth, random), {}, kStart, 120);
    const Pose2 guess{truth.x_m + 0.4 * (n % 2 == 0 ? 1 : -1),
                      truth.y_m + 0.3 * (n % 4 < 2 ? 1 : -1), truth.yaw_rad + 0.1};
    const Error error = error_of(match_scan(field, beams, guess, settings).pose, truth);
    if (std::hypot(error[0], error[1]) < 0.05 && std::abs(error[2]) < 0.01) ++found;
  }
  // The search needs most places, not all: it looks again from others.
  EXPECT_GT(found, kPlaces * 7 / 10);
}

TEST(ScanMatch, InACorridorKnowsAllButThePlaceAlongIt) {
  // 200 m long, at an angle; the scanner sees 40 m.
  constexpr double kYaw_rad = 0.4;
  const double c = std::cos(kYaw_rad), s = std::sin(kYaw_rad);
  std::vector<Shape> map;
  for (const double side : {-1.5, 1.5}) {
    map.push_back(test::box(-s * (side + std::copysign(0.25, side)),
                            c * (side + std::copysign(0.25, side)), 200.0, 0.5, kYaw_rad));
  }
  const DistanceField field(map, 0.1);
  const HallScanner scanner;
  RandomEngine random = random_stream(4, "corridor");
  const Pose2 truth{1.0 * c, 1.0 * s, 0.7};
  const auto beams = beams_of(scanner.measure_standing(map, truth, random), {}, kStart, 1000);
  const Pose2 guess{truth.x_m + 0.3 * c - 0.1 * s, truth.y_m + 0.3 * s + 0.1 * c, 0.72};
  const Match match = match_scan(field, beams, guess, MatchSettings{});
  const Weakness weak = weakness(match.information);
  EXPECT_NEAR(weak.direction_rad, kYaw_rad, 0.002);
  EXPECT_GT(weak.sigma_m, 1.0);
  EXPECT_LT(weak.yaw_sigma_rad, 0.001);
  EXPECT_NEAR(match.pose.yaw_rad, truth.yaw_rad, 0.002);
  // Across it is known; along it stays as guessed.
  const double along_m = c * (match.pose.x_m - truth.x_m) + s * (match.pose.y_m - truth.y_m);
  const double across_m = c * (match.pose.y_m - truth.y_m) - s * (match.pose.x_m - truth.x_m);
  EXPECT_NEAR(across_m, 0.0, 0.01);
  EXPECT_NEAR(along_m, 0.3, 0.15);
}

TEST(ScanMatch, InTheMiddleOfACircleKnowsAllButTheYaw) {
  const std::vector<Shape> map{cylinder(0.0, 0.0, 6.0)};  // its inside is as good as its outside
  const DistanceField field(map, kCell_m);
  HallScanner scanner;
  scanner.mount = {};
  RandomEngine random = random_stream(5, "circle");
  const auto beams =
      beams_of(scanner.measure_standing(map, {0.0, 0.0, 1.0}, random), {}, kStart, 1000);
  const Match match = match_scan(field, beams, {0.05, -0.04, 1.03}, MatchSettings{});
  const Weakness weak = weakness(match.information);
  EXPECT_GT(weak.yaw_sigma_rad, 0.1);
  EXPECT_LT(weak.sigma_m, 0.02);
  EXPECT_NEAR(match.pose.x_m, 0.0, 0.01);
  EXPECT_NEAR(match.pose.y_m, 0.0, 0.01);
  EXPECT_NEAR(match.pose.yaw_rad, 1.03, 0.03);  // the guess
}

TEST(ScanMatch, BeamsThatWentThroughTheMapAreThoseThatGoOnBehindAWall) {
  const std::vector<Shape> map{box(5.0, 0.0, 0.5, 10.0), box(-9.25, 0.0, 0.5, 10.0)};
  const DistanceField field(map, 0.05);
  const auto beam = [](float range_m) { return Beam{range_m, 0.0F, 1.0F, 0.0F, 0.0F}; };
  const std::vector<Beam> beams{beam(3.0F), beam(4.75F), beam(5.1F), beam(5.4F), beam(8.0F)};
  EXPECT_EQ(beams_through_map(field, beams, {0.0, 0.0, 0.0}, 0.5), 2);
  EXPECT_EQ(beams_through_map(field, beams, {0.0, 0.0, std::numbers::pi}, 0.5), 0);
}

TEST(ScanMatch, OfNoBeamsThatFitSaysNothing) {
  const DistanceField field(hall(), kCell_m);
  const std::vector<Beam> beams{{1000.0F, 0.0F}};
  const Match match = match_scan(field, beams, {1.0, 2.0, 0.5}, MatchSettings{});
  EXPECT_EQ(match.used, 0);
  EXPECT_EQ(match.outside, 1);
  EXPECT_EQ(match.share(), 0.0);
  EXPECT_EQ(match.pose.x_m, 1.0);
  EXPECT_EQ(match.pose.yaw_rad, 0.5);
  EXPECT_EQ(match.information.x_x, 0.0);
  EXPECT_EQ(weakness(match.information).sigma_m, Weakness::kNothing);
}

}  // namespace
}  // namespace tether
