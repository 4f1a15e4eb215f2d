#include "sim/sensor/lidar_model.hpp"

#include <gtest/gtest.h>

#include <numbers>

#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using std::numbers::pi;
using test::at_ms;

/// Without errors, above the vehicle, at the axle.
LidarSettings clean() {
  LidarSettings s = lidar_preset("custom");
  s.mount_x_m = 0.0;
  s.height_m = 1.0;
  s.noise_m = 0.0;
  s.range_step_m = 0.0;
  s.range_10_m = 1e3;
  s.range_max_m = 200.0;
  s.range_min_m = 0.0;
  return s;
}

Shape box(double x_m, double y_m, double length_m, double width_m, double reflectivity = 0.5) {
  return {.pose = {x_m, y_m, 0.0},
          .length_m = length_m,
          .width_m = width_m,
          .reflectivity = reflectivity};
}

/// Inner sides at ±10 m.
std::vector<Shape> square_hall() {
  return {box(0, 10.1, 20.4, 0.2), box(0, -10.1, 20.4, 0.2), box(10.1, 0, 0.2, 20),
          box(-10.1, 0, 0.2, 20)};
}

/// A wall ahead, its face at x = distance.
std::vector<Shape> wall_ahead(double distance_m, double reflectivity = 0.5) {
  return {box(distance_m + 0.1, 0, 0.2, 4000, reflectivity)};
}

PoseTrack standing() {
  PoseTrack track;
  track.add(kStart, {});
  return track;
}

Scan scan_of(const LidarSettings& settings, const std::vector<Shape>& shapes,
             const PoseTrack& track = standing(), std::uint64_t seed = 1) {
  return LidarModel(settings, VehicleConfig{}, shapes, seed, "AGV").turn(kStart, track);
}

double square_range_m(double x_m, double y_m, double angle_rad) {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  return std::min((c > 0 ? 10 - x_m : 10 + x_m) / std::abs(c),
                  (s > 0 ? 10 - y_m : 10 + y_m) / std::abs(s));
}

// ---------------------------------------------------------------------------- geometry

TEST(LidarModel, SeesASquareHallFromItsMiddle) {
  const Scan scan = scan_of(clean(), square_hall());
  ASSERT_EQ(scan.range_m.size(), 541U);
  EXPECT_EQ(scan.range_m[270], 10.0F) << "the middle beam points ahead";
  EXPECT_NEAR(scan.angle_rad(540), 0.75 * pi, 1e-12);
  for (std::size_t i = 0; i < 541; ++i) {
    EXPECT_NEAR(scan.range_m[i], square_range_m(0, 0, scan.angle_rad(i)), 1e-5);
  }
}

TEST(LidarModel, OfAWholeTurnHasNoBeamTwice) {
  LidarSettings s = clean();
  s.fov_rad = 2 * pi;
  s.beams = 360;
  s.rate_hz = 10.0;
  EXPECT_NEAR(s.angle_increment_rad(), pi / 180, 1e-12);
  EXPECT_NEAR(s.time_increment_s(), 0.1 / 360, 1e-12);
  s.beams = 1;
  EXPECT_EQ(scan_of(s, square_hall()).range_m.size(), 1U);
}

TEST(LidarModel, IsWhereItIsMounted) {
  LidarSettings s = clean();
  s.mount_x_m = 1.0;
  s.mount_y_m = 2.0;
  s.mount_yaw_rad = 0.5;
  PoseTrack track;
  track.add(kStart, {3.0, -1.0, pi / 2});
  const Scan scan = scan_of(s, square_hall(), track);
  for (std::size_t i = 0; i < 541; ++i) {
    EXPECT_NEAR(scan.range_m[i], square_range_m(1, 0, pi / 2 + 0.5 + scan.angle_rad(i)), 1e-5);
  }
  EXPECT_EQ(scan.mount.yaw_rad, 0.5);
}

TEST(LidarModel, OnATurningVehicleIsDistortedByItsMotion) {
  LidarSettings s = clean();
  s.rate_hz = 10.0;
  PoseTrack track;  // 2 rad/s and 3 m/s along y, in steps of 10 ms
  for (int i = 0; i <= 20; ++i) track.add(at_ms(10 * i), {1.0, -3.0 + 0.03 * i, 3.0 + 0.02 * i});
  const Scan scan = scan_of(s, square_hall(), track);
  EXPECT_NEAR(to_seconds(scan.end() - scan.stamp), 0.075, 1e-6) << "270 of 360 degrees";
  for (std::size_t i = 0; i < 541; ++i) {
    const double t_s = to_seconds(scan.time_of(i));
    EXPECT_NEAR(scan.range_m[i],
                square_range_m(1.0, -3.0 + 3.0 * t_s, 3.0 + 2.0 * t_s + scan.angle_rad(i)), 1e-5);
  }
}

TEST(LidarModel, SeesWhatMovesWhereItIsByThen) {
  LidarSettings s = clean();
  s.rate_hz = 10.0;
  Shape trolley = box(5, 0, 2, 8);
  trolley.vx_mps = 2.0;
  LidarModel model(s, VehicleConfig{}, square_hall(), 1, "AGV");
  const Scan scan = model.turn(kStart, standing(), {trolley});
  EXPECT_NEAR(scan.range_m[270], 4.0 + 2.0 * to_seconds(scan.time_of(270)), 1e-5);
  EXPECT_EQ(model.turn(kStart, standing()).range_m[270], 10.0F);
}

TEST(LidarModel, DoesNotSeeThroughItsOwnVehicle) {
  LidarSettings s = clean();
  s.mount_x_m.reset();
  s.height_m = 0.3;  // the chassis is from 0.15 to 0.65 m
  const Scan scan = scan_of(s, square_hall());
  EXPECT_EQ(scan.mount.x_m, 1.5);
  for (std::size_t i = 0; i < 541; ++i) {
    const bool behind = std::abs(scan.angle_rad(i)) > pi / 2 + 1e-9;
    EXPECT_EQ(scan.range_m[i] == 0.0F, behind) << scan.angle_rad(i);
  }
  s.height_m = 1.0;
  EXPECT_GT(scan_of(s, square_hall()).range_m[0], 0.0F);
  s.height_m = 0.7;  // between its wheels, 0.4 m thick and 0.53 m long there
  s.mount_x_m = 0.0;
  const Scan between = scan_of(s, square_hall());
  EXPECT_GT(between.range_m[270], 0.0F);
  EXPECT_EQ(between.range_m[270 + 180], 0.0F) << "to the left";
  EXPECT_EQ(between.range_m[270 - 180], 0.0F);
}

// ---------------------------------------------------------------------------- errors

TEST(LidarModel, NoiseHasItsVarianceAndNoBias) {
  LidarSettings s = clean();
  s.noise_m = 0.02;
  s.noise_per_m = 0.003;
  LidarModel model(s, VehicleConfig{}, square_hall(), 3, "AGV");
  double chi2 = 0.0, sum = 0.0;
  int n = 0;
  for (int turn = 0; turn < 40; ++turn) {
    const Scan scan = model.turn(kStart, standing());
    for (std::size_t i = 0; i < 541; ++i, ++n) {
      const double true_m = square_range_m(0, 0, scan.angle_rad(i));
      const double z = (scan.range_m[i] - true_m) / std::hypot(0.02, 0.003 * true_m);
      chi2 += z * z;
      sum += z;
    }
  }
  // A chi-square of n degrees of freedom has the standard deviation sqrt(2 n); four of them.
  EXPECT_NEAR(chi2, n, 4.0 * std::sqrt(2.0 * n));
  EXPECT_NEAR(sum / n, 0.0, 4.0 / std::sqrt(n));
}

TEST(LidarModel, RangesAreStepsBetweenItsLimits) {
  LidarSettings s = clean();
  s.range_step_m = 0.25;
  s.range_min_m = 10.2;
  s.range_max_m = 12.0;
  const Scan scan = scan_of(s, square_hall());
  for (std::size_t i = 0; i < 541; ++i) {
    const double true_m = square_range_m(0, 0, scan.angle_rad(i));
    const double step_m = 0.25 * std::round(true_m / 0.25);
    const bool within = step_m >= 10.2 && step_m <= 12.0 && true_m <= 12.0;
    EXPECT_NEAR(scan.range_m[i], within ? step_m : 0.0, 1e-6);
  }
}

TEST(LidarModel, LosesASurfaceFromTheAngleOnThatLambertSays) {
  LidarSettings s = clean();
  s.range_10_m = 5.0;
  s.beams = 2701;
  const double wall_m = 3.0, reflectivity = 0.4;
  const Scan scan = scan_of(s, wall_ahead(wall_m, reflectivity));
  // r = wall/cos b up to 5 sqrt(10 * 0.4 cos b): cos^3 b = wall^2 / (25 * 4).
  const double onset_rad = std::acos(std::cbrt(wall_m * wall_m / 100.0));
  for (std::size_t i = 0; i < scan.range_m.size(); ++i) {
    const double off_rad = std::abs(scan.angle_rad(i)) - onset_rad;
    if (std::abs(off_rad) < 1e-6) continue;
    EXPECT_EQ(scan.range_m[i] > 0.0F, off_rad < 0.0) << scan.angle_rad(i);
  }
}

TEST(LidarModel, SeesTenPercentUpToItsRange) {
  LidarSettings s = clean();
  s.range_10_m = 5.0;
  EXPECT_GT(scan_of(s, wall_ahead(4.99, 0.1)).range_m[270], 0.0F);
  EXPECT_EQ(scan_of(s, wall_ahead(5.01, 0.1)).range_m[270], 0.0F);
  EXPECT_GT(scan_of(s, wall_ahead(14.9, 0.9)).range_m[270], 0.0F) << "thrice, for nine times";
  EXPECT_EQ(scan_of(s, wall_ahead(15.1, 0.9)).range_m[270], 0.0F);
}

TEST(LidarModel, BeamsDropOutAtRandomAsOftenAsTold) {
  LidarSettings s = clean();
  s.dropout_share = 0.1;
  LidarModel model(s, VehicleConfig{}, square_hall(), 5, "AGV");
  int lost = 0;
  for (int turn = 0; turn < 20; ++turn) {
    const Scan scan = model.turn(kStart, standing());
    lost += static_cast<int>(std::count(scan.range_m.begin(), scan.range_m.end(), 0.0F));
  }
  // Binomial: 10820 · 0.1 ± 31; four of them.
  EXPECT_NEAR(lost, 1082, 4 * 31);
}

// ---------------------------------------------------------------------------- mixed pixels

/// A box whose edge at y = 0 covers half of the middle beam, `gap_m` before a wall.
std::vector<Shape> edge_before_wall(double gap_m) {
  std::vector<Shape> shapes = wall_ahead(5.0 + gap_m);
  shapes.push_back(box(5.5, 2.0, 1.0, 4.0));
  return shapes;
}

TEST(LidarModel, ABeamAtAnEdgeSeesSomethingBetween) {
  LidarSettings s = clean();
  s.divergence_rad = 0.015;
  std::vector<Shape> shapes = wall_ahead(5.3);
  shapes.push_back(box(5.1, 2.0, 0.2, 4.0));  // its face at 5 m, from y = 0 on
  const Scan scan = scan_of(s, shapes);
  EXPECT_NEAR(scan.range_m[265], 5.3 / std::cos(scan.angle_rad(265)), 1e-5);
  EXPECT_NEAR(scan.range_m[275], 5.0 / std::cos(scan.angle_rad(275)), 1e-5);
  EXPECT_GT(scan.range_m[270], 5.01);
  EXPECT_LT(scan.range_m[270], 5.29);
  s.divergence_rad = 0.0;
  EXPECT_NEAR(scan_of(s, shapes).range_m[271], 5.0 / std::cos(scan.angle_rad(271)), 1e-5);
}

TEST(LidarModel, ABeamAtAnEdgeSeesTheNearerIfTheOtherIsFarBehind) {
  LidarSettings s = clean();
  s.divergence_rad = 0.015;
  EXPECT_NEAR(scan_of(s, edge_before_wall(4.0)).range_m[270], 5.0, 1e-3);
}

TEST(LidarModel, ABeamAtAnEdgePassesOverAnEchoWithTooLittleLight) {
  LidarSettings s = clean();
  s.divergence_rad = 0.015;
  s.range_10_m = 10.0;
  std::vector<Shape> shapes = edge_before_wall(2.0);
  shapes[1].reflectivity = 0.01;
  EXPECT_NEAR(scan_of(s, shapes).range_m[270], 7.0, 1e-3);
}

// ---------------------------------------------------------------------------- random numbers

TEST(LidarModel, IsTheSameForTheSameSeedAndOtherwiseNot) {
  LidarSettings s = clean();
  s.noise_m = 0.01;
  EXPECT_EQ(scan_of(s, square_hall()).range_m, scan_of(s, square_hall()).range_m);
  EXPECT_NE(scan_of(s, square_hall()).range_m, scan_of(s, square_hall(), standing(), 2).range_m);
}

TEST(LidarModel, DrawsTheSameErrorsWhateverItMeets) {
  LidarSettings s = clean();
  s.noise_m = 0.01;
  const auto second_error = [&](const std::vector<Shape>& first) {
    LidarModel model(s, VehicleConfig{}, wall_ahead(5.0), 1, "AGV");
    model.turn(kStart, standing(), first);
    return model.turn(kStart, standing()).range_m;
  };
  EXPECT_EQ(second_error({}), second_error(square_hall()));
}

// ---------------------------------------------------------------------------- where it was

TEST(PoseTrack, IsStraightBetweenPosesAndTurnsTheShortWay) {
  PoseTrack track;
  track.add(at_ms(0), {0.0, 0.0, 3.1});
  track.add(at_ms(10), {1.0, 2.0, -3.1});
  std::size_t near = 0;
  const Pose2 half = track.at(at_ms(5), near);
  EXPECT_NEAR(half.x_m, 0.5, 1e-12);
  EXPECT_NEAR(wrap_angle(half.yaw_rad), pi, 1e-9);
  EXPECT_EQ(track.at(at_ms(-5), near).yaw_rad, 3.1) << "before it began";
  EXPECT_NEAR(track.at(at_ms(20), near).x_m, 2.0, 1e-12) << "it goes on";
}

TEST(PoseTrack, ForgetsWhatIsNotNeeded) {
  PoseTrack track;
  for (int i = 0; i <= 10; ++i) track.add(at_ms(i), {0.1 * i * i, 0.0, 0.0});
  const auto at = [&](double ms) {
    std::size_t near = 0;
    return track.at(at_ms(ms), near).x_m;
  };
  const double within_m = at(7.5), beyond_m = at(12.0);
  track.forget_before(at_ms(7.2));
  EXPECT_EQ(at(7.5), within_m);
  EXPECT_EQ(at(12.0), beyond_m);
  EXPECT_EQ(at(0.0), 0.1 * 49) << "no longer known";
  track.forget_before(at_ms(100));
  EXPECT_EQ(at(12.0), beyond_m);
  PoseTrack one = standing();
  one.forget_before(at_ms(5));
  EXPECT_FALSE(one.empty());
}

}  // namespace
}  // namespace tether
