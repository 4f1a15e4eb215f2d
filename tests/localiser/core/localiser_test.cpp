#include "onboard/localiser/localiser.hpp"

#include <gtest/gtest.h>

#include "tests/localiser/drive.hpp"

namespace tether {
namespace {

using test::any_free_pose;
using test::box;
using test::Drive;
using test::hall;
using test::HallScanner;
using test::LocalisedDrive;
using test::off_m;
using test::off_rad;

using State = Localisation::State;

Localiser::Settings settings_at(const std::optional<Pose2>& start) {
  Localiser::Settings settings;
  settings.tracker = {Drive::kTrack_m, Drive::kWheelNoise_m};
  settings.start = start;
  return settings;
}

std::shared_ptr<const DistanceField> field_of(const std::vector<Shape>& map) {
  return std::make_shared<const DistanceField>(map, 0.05);
}

const Pose2 kStartPose{4.0, 2.0, -1.0};

/// A vehicle that stands at kStartPose and knows it, scan after scan; its wheels stand, too.
class Standing {
 public:
  explicit Standing(const std::vector<Shape>& map)
      : localiser_(settings_at(kStartPose), field_of(map), random_stream(1, "search")) {}

  Scan scan(const std::vector<Shape>& around) {
    const Instant when = kStart + from_seconds(scans_ / 15.0);
    return scanner_.measure(
        around, when, scans_++, [](Instant) { return kStartPose; }, random_);
  }
  Localisation see(const Scan& scan, const Pose2& wheels = {}, double way_m = 0.0) {
    localiser_.on_odometry({scan.stamp, wheels, way_m, {}});
    return localiser_.on_scan(scan);
  }

 private:
  Localiser localiser_;
  HallScanner scanner_;
  RandomEngine random_ = random_stream(1, "scanner");
  int scans_ = 0;
};

TEST(Localiser, TracksAVehicleThatWandersAmongPeople) {
  const std::vector<Shape> map = hall();
  LocalisedDrive drive(map, field_of(map), settings_at(kStartPose), kStartPose, HallScanner(), 6,
                       1);
  while (drive.time_s() < 10.0) {
    const Localisation found = drive.next();
    ASSERT_EQ(found.state, State::tracking);
    ASSERT_LT(off_m(found, drive.truth()), 0.02);
    ASSERT_LT(off_rad(found, drive.truth()), 0.01);
  }
}

TEST(Localiser, FindsAVehicleThatDoesNotKnowItsStart) {
  const std::vector<Shape> map = hall();
  LocalisedDrive drive(map, field_of(map), settings_at(std::nullopt), kStartPose, HallScanner(), 4,
                       2);
  Localisation found;
  while (drive.time_s() < 5.0 && found.state == State::searching) found = drive.next();
  EXPECT_EQ(found.state, State::tracking);
  EXPECT_LT(off_m(found, drive.truth()), 0.05);
  EXPECT_LT(off_rad(found, drive.truth()), 0.01);
}

TEST(Localiser, GoesOnByOdometryWhileItsSightIsBlockedAndThenIsLost) {
  const std::vector<Shape> map = hall();
  Standing vehicle(map);
  // All around it, half a metre away.
  const std::vector<Shape> cage{test::cylinder(kStartPose.x_m, kStartPose.y_m, 0.9)};
  std::vector<State> states;
  for (int i = 0; i < 2 * Localiser::kMostMisses; ++i) {
    states.push_back(vehicle.see(vehicle.scan(i < 3 ? map : cage)).state);
  }
  for (int i = 0; i < 2 * Localiser::kMostMisses; ++i) {
    const State expected = i < 3                                ? State::tracking
                           : i < 3 + Localiser::kMostMisses - 1 ? State::degenerate
                                                                : State::searching;
    EXPECT_EQ(states[static_cast<std::size_t>(i)], expected) << i;
  }
}

/// Posts, one beside the other, around the scanner of a vehicle at kStartPose; angles in its frame.
std::vector<Shape> fence(double radius_m, double from_rad, double to_rad) {
  const Pose2 eye = compose(kStartPose, HallScanner().mount);
  std::vector<Shape> posts;
  for (double angle = from_rad; angle <= to_rad; angle += 0.03) {
    posts.push_back(test::cylinder(eye.x_m + radius_m * std::cos(eye.yaw_rad + angle),
                                   eye.y_m + radius_m * std::sin(eye.yaw_rad + angle),
                                   0.02 * radius_m));
  }
  return posts;
}

std::vector<Shape> together(std::vector<Shape> a, const std::vector<Shape>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// How many of 2 · kMostMisses scans of `around` are needed until it is lost; none if it never is.
std::optional<int> scans_until_lost(const std::vector<Shape>& map,
                                    const std::vector<Shape>& around) {
  Standing vehicle(map);
  for (int i = 1; i <= 2 * Localiser::kMostMisses; ++i) {
    if (vehicle.see(vehicle.scan(around)).state == State::searching) return i;
  }
  return std::nullopt;
}

TEST(Localiser, ASlitThroughWhichItSeesAnEighthOfTheHallIsNotEnough) {
  const std::vector<Shape> map = hall();
  const auto cage = together(fence(1.2, -2.4, -0.3), fence(1.2, 0.3, 2.4));
  EXPECT_EQ(scans_until_lost(map, together(map, cage)), Localiser::kMostMisses);
  const auto wider = together(fence(1.2, -2.4, -1.0), fence(1.2, 1.0, 2.4));
  EXPECT_EQ(scans_until_lost(map, together(map, wider)), std::nullopt) << "four tenths are";
}

TEST(Localiser, BeamsThroughWhatTheMapShowsSpeakAgainstAPlace) {
  const std::vector<Shape> far = together(hall(), fence(3.0, -1.6, 1.6));
  EXPECT_EQ(scans_until_lost(hall(), far), std::nullopt) << "something new hides the hall";
  const std::vector<Shape> map = together(hall(), fence(1.5, -1.6, 1.6));
  EXPECT_EQ(scans_until_lost(map, far), Localiser::kMostMisses) << "what should hide that is gone";
}

TEST(Localiser, IsLostWhenItDoesNotKnowHowFarItWent) {
  const std::vector<Shape> map = hall();
  Standing vehicle(map);
  std::vector<State> states;
  for (int i = 0; i < 15;
       ++i) {  // each time its wheels are set to another pose it may be 0.1 m off
    Scan scan = vehicle.scan(map);
    if (i > 0) std::fill(scan.range_m.begin() + 15, scan.range_m.end(), 0.0F);
    const double elsewhere_m = i % 2 == 1 ? 100.0 : 0.0;
    states.push_back(vehicle.see(scan, {elsewhere_m, 0.0, 0.0}, elsewhere_m).state);
  }
  EXPECT_EQ(states[8], State::degenerate) << "0.28 m";
  EXPECT_EQ(states[10], State::searching) << "0.32 m";
}

TEST(Localiser, KnowsWhereItIsBehindANewThingThatHidesMostOfTheHall) {
  const std::vector<Shape> map = hall();
  Standing vehicle(map);
  std::vector<Shape> with_box = map;  // a metre ahead
  with_box.push_back(box(kStartPose.x_m + 1.5 * std::cos(kStartPose.yaw_rad),
                         kStartPose.y_m + 1.5 * std::sin(kStartPose.yaw_rad), 1.0, 4.0,
                         kStartPose.yaw_rad));
  for (int i = 0; i < 3 * Localiser::kMostMisses; ++i) {
    const Localisation found = vehicle.see(vehicle.scan(with_box));
    ASSERT_EQ(found.state, State::tracking) << i;
    ASSERT_LT(off_m(found, kStartPose), 0.02);
    ASSERT_GT(found.outside, found.beams);
  }
}

TEST(Localiser, InACorridorIsDegenerateAlongItAndGoesOnByOdometry) {
  constexpr double kYaw_rad = 0.4;
  const double c = std::cos(kYaw_rad), s = std::sin(kYaw_rad);
  std::vector<Shape> map;
  for (const double y_m : {-1.75, 1.75})
    map.push_back(box(-s * y_m, c * y_m, 200.0, 0.5, kYaw_rad));
  const auto pose_at = [&](Instant when) {
    const double way_m = to_seconds(when);  // 1 m/s
    return Pose2{c * way_m, s * way_m, kYaw_rad};
  };
  Localiser localiser(settings_at(pose_at(kStart)), std::make_shared<const DistanceField>(map, 0.1),
                      random_stream(1, "search"));
  const HallScanner scanner;
  RandomEngine random = random_stream(1, "scanner");
  for (int i = 0; i < 60; ++i) {
    const Instant when = kStart + from_seconds(i / 15.0);
    const Scan scan = scanner.measure(map, when, i, pose_at, random);
    const double way_m = to_seconds(scan.end());
    localiser.on_odometry({scan.end(), {way_m, 0.0, 0.0}, way_m, {1.0, 0.0}});
    const Localisation found = localiser.on_scan(scan);
    ASSERT_EQ(found.state, State::degenerate) << i;
    ASSERT_NEAR(found.weak.direction_rad, kYaw_rad, 0.005);
    ASSERT_LT(off_m(found, pose_at(scan.end())), 0.1);
    // Known well across, and along it ever less.
    const PoseCovariance& p = found.covariance;
    const double across_m2 = s * s * p.x_x - 2.0 * s * c * p.x_y + c * c * p.y_y;
    ASSERT_LT(std::sqrt(across_m2), 0.01);
    ASSERT_GT(p.x_x + p.y_y, 0.04 * 0.04);
  }
}

TEST(Localiser, InACircleIsDegenerateInYaw) {
  const std::vector<Shape> map{test::cylinder(0.0, 0.0, 6.0)};
  HallScanner scanner;
  scanner.mount = {};
  RandomEngine random = random_stream(1, "scanner");
  Localiser localiser(settings_at(Pose2{0.0, 0.0, 0.3}), field_of(map), random_stream(1, "search"));
  const Scan scan = scanner.measure_standing(map, {0.0, 0.0, 0.3}, random);
  localiser.on_odometry({kStart, {}, 0.0, {}});
  const Localisation found = localiser.on_scan(scan);
  EXPECT_EQ(found.state, State::degenerate);
  EXPECT_GT(found.weak.yaw_sigma_rad, Localiser::kWeak_rad);
  EXPECT_LT(found.weak.sigma_m, 0.02);
}

TEST(Localiser, GoesOnWhenItsWheelsAreSetToAnotherPose) {
  const std::vector<Shape> map = hall();
  Standing vehicle(map);
  for (int i = 0; i < 20; ++i) {
    const Pose2 wheels{i < 10 ? 100.0 : 0.0, 0.0, 0.0};
    const Localisation found = vehicle.see(vehicle.scan(map), wheels, i < 10 ? 50.0 : 0.0);
    ASSERT_EQ(found.state, State::tracking) << i;
    ASSERT_LT(off_m(found, kStartPose), 0.02);
  }
}

TEST(Localiser, ScansOfWhichAlmostNothingArrivedAreNoMisses) {
  const std::vector<Shape> map = hall();
  Standing vehicle(map);
  for (int i = 0; i < 30; ++i) {
    Scan scan = vehicle.scan(map);
    if (i > 0) std::fill(scan.range_m.begin() + 15, scan.range_m.end(), 0.0F);
    const Localisation found = vehicle.see(scan);
    ASSERT_EQ(found.state, i > 0 ? State::degenerate : State::tracking) << i;
    ASSERT_LT(off_m(found, kStartPose), 0.02);
  }
}

TEST(Localiser, NoticesThatItWasCarriedElsewhereAndFindsItself) {
  const std::vector<Shape> map = hall();
  LocalisedDrive drive(map, field_of(map), settings_at(kStartPose), kStartPose, HallScanner(), 4,
                       3);
  while (drive.time_s() < 1.0) drive.next();
  drive.drive().carry_to({-12.0, -8.0, 1.0});
  Localisation found;
  bool was_lost = false;
  while (drive.time_s() < 6.0 && (!was_lost || found.state == State::searching)) {
    found = drive.next();
    was_lost = was_lost || found.state == State::searching;
  }
  EXPECT_TRUE(was_lost);
  EXPECT_EQ(found.state, State::tracking);
  EXPECT_LT(off_m(found, drive.truth()), 0.05);
  CounterList counters;
  drive.localiser().list_counters(counters);
  EXPECT_NE(
      std::find(counters.begin(), counters.end(), CounterList::value_type{"localiser.lost", 1}),
      counters.end());
}

}  // namespace
}  // namespace tether
