#pragma once

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "common/vehicle/dead_reckoning.hpp"
#include "onboard/localiser/localiser.hpp"
#include "tests/localiser/hall.hpp"

namespace tether::test {

/// People who walk to and fro, each on a circle of its own.
class People {
 public:
  People(int count, double length_m, double width_m, RandomEngine& random) {
    for (int i = 0; i < count; ++i) {
      centres_.push_back({length_m * (uniform_01(random) - 0.5),
                          width_m * (uniform_01(random) - 0.5), 6.28 * uniform_01(random)});
    }
  }
  /// No person walks into the vehicle.
  void add_to(std::vector<Shape>& shapes, double t_s, const Pose2& vehicle) const {
    for (const Pose2& centre : centres_) {
      const double angle_rad = centre.yaw_rad + 0.7 * t_s;  // 1 m/s
      const Shape person = cylinder(centre.x_m + 1.5 * std::cos(angle_rad),
                                    centre.y_m + 1.5 * std::sin(angle_rad), 0.25);
      if (distance_m(person, {vehicle.x_m, vehicle.y_m}) > 1.0) shapes.push_back(person);
    }
  }

 private:
  std::vector<Pose2> centres_;
};

/// A vehicle that wanders about a hall and turns away from what is in its way, and its odometry:
/// each wheel's way is off by 5 mm after 1 m, which grows with its root, and as much it slips
/// aside.
class Drive {
 public:
  static constexpr double kTrack_m = 1.0;
  static constexpr double kWheelNoise_m = 0.005;
  static constexpr Duration kStep = std::chrono::milliseconds{5};
  static constexpr std::size_t kEach = 4;  ///< steps between readings, and between its decisions

  Drive(const std::vector<Shape>& map, const Pose2& start, RandomEngine random)
      : map_(map), random_(random) {
    odometry_.pose = {};
    truth_.push_back(start);
    readings_.push_back({kStart, {}, 0.0, {}});
  }

  /// At a time that has been, or a little ahead.
  Pose2 pose_at(Instant when) {
    while (kStart + kStep * static_cast<int>(truth_.size() - 1) < when) step();
    const auto i = static_cast<std::size_t>((when - kStart) / kStep);
    if (i + 1 >= truth_.size()) return truth_.back();
    const double share = to_seconds((when - kStart) % kStep) / to_seconds(kStep);
    const Pose2 between_them = relative_to(truth_[i], truth_[i + 1]);
    return compose(truth_[i], {share * between_them.x_m, share * between_them.y_m,
                               share * between_them.yaw_rad});
  }
  /// Carries the vehicle elsewhere, without a motion of its wheels.
  void carry_to(const Pose2& pose) { truth_.back() = pose; }
  void stand() { stands_ = true; }

  /// Readings of the wheels from one time to another.
  std::vector<OdometryReading> readings(Instant from, Instant to) const {
    std::vector<OdometryReading> some;
    for (const OdometryReading& reading : readings_) {
      if (reading.stamp > from && reading.stamp <= to) some.push_back(reading);
    }
    return some;
  }

 private:
  double clear_m(double left_rad) const {
    const Pose2& at = truth_.back();
    const double direction_rad = at.yaw_rad + left_rad;
    double way_m = 0.0;
    while (way_m < 3.0 && is_free(map_,
                                  {at.x_m + (way_m + 0.2) * std::cos(direction_rad),
                                   at.y_m + (way_m + 0.2) * std::sin(direction_rad)},
                                  0.5)) {
      way_m += 0.2;
    }
    return way_m;
  }
  void decide() {
    const double ahead_m = clear_m(0.0);
    if (uniform_01(random_) < 0.01) wander_radps_ = 0.8 * (uniform_01(random_) - 0.5);
    wish_ = {ahead_m < 0.4 ? 0.0 : std::min(1.5, ahead_m), wander_radps_};
    if (ahead_m < 2.5) wish_.omega_radps = clear_m(0.6) > clear_m(-0.6) ? 0.8 : -0.8;
    if (stands_) wish_ = {};
  }
  void step() {
    if ((truth_.size() - 1) % kEach == 0) decide();
    const Twist before = twist_;
    twist_.v_mps += std::clamp(wish_.v_mps - twist_.v_mps, -0.01, 0.005);  // 2 and 1 m/s²
    twist_.omega_radps += std::clamp(wish_.omega_radps - twist_.omega_radps, -0.01, 0.01);
    roll({0.5 * (before.v_mps + twist_.v_mps), 0.5 * (before.omega_radps + twist_.omega_radps)});
  }
  void roll(const Twist& mean) {
    const double dt_s = to_seconds(kStep);
    const double half_m = 0.5 * kTrack_m * mean.omega_radps * dt_s;
    const double left_m = mean.v_mps * dt_s - half_m, right_m = mean.v_mps * dt_s + half_m;
    DeadReckoning exact{truth_.back(), {}, 0.0};
    exact.move({left_m, right_m, 0.0, 0.0}, kTrack_m);
    boost::random::normal_distribution<double> normal;
    const double aside_m = kWheelNoise_m * std::sqrt(std::abs(exact.distance_m)) * normal(random_);
    truth_.push_back(compose(exact.pose, {0.0, aside_m, 0.0}));
    const double left_off_m = kWheelNoise_m * std::sqrt(std::abs(left_m)) * normal(random_);
    const double right_off_m = kWheelNoise_m * std::sqrt(std::abs(right_m)) * normal(random_);
    odometry_.move({left_m + left_off_m, right_m + right_off_m, 0.0, 0.0}, kTrack_m);
    if ((truth_.size() - 1) % kEach != 0) return;
    readings_.push_back({kStart + kStep * static_cast<int>(truth_.size() - 1), odometry_.pose,
                         odometry_.distance_m, twist_});
  }

  const std::vector<Shape>& map_;
  RandomEngine random_;
  std::vector<Pose2> truth_;  ///< each kStep
  std::vector<OdometryReading> readings_;
  DeadReckoning odometry_;
  Twist twist_;
  Twist wish_;
  double wander_radps_ = 0.0;
  bool stands_ = false;
};

/// A localiser on a vehicle that wanders about.
class LocalisedDrive {
 public:
  LocalisedDrive(const std::vector<Shape>& map, std::shared_ptr<const DistanceField> field,
                 const Localiser::Settings& settings, const Pose2& start,
                 const HallScanner& scanner, int people, std::uint64_t seed)
      : map_(map),
        scanner_(scanner),
        random_(random_stream(seed, "scanner")),
        drive_(map, start, random_stream(seed, "drive")),
        people_(people, 26.0, 16.0, random_),
        localiser_(settings, std::move(field), random_stream(seed, "search")) {}

  /// The next scan, as long as a turn.
  Localisation next() {
    const Instant start = kStart + from_seconds(static_cast<double>(scans_) / scanner_.rate_hz);
    std::vector<Shape> world = map_;
    people_.add_to(world, to_seconds(start), drive_.pose_at(start));
    const Scan scan = scanner_.measure(
        world, start, scans_++, [&](Instant when) { return drive_.pose_at(when); }, random_);
    const auto news = drive_.readings(heard_, scan.end());
    for (const OdometryReading& reading : news) localiser_.on_odometry(reading);
    if (!news.empty()) heard_ = news.back().stamp;
    truth_ = drive_.pose_at(scan.end());
    return localiser_.on_scan(scan);
  }

  Drive& drive() { return drive_; }
  const Pose2& truth() const { return truth_; }  ///< at the end of the last scan
  double time_s() const { return static_cast<double>(scans_) / scanner_.rate_hz; }
  const Localiser& localiser() const { return localiser_; }

 private:
  const std::vector<Shape>& map_;
  HallScanner scanner_;
  RandomEngine random_;
  Drive drive_;
  People people_;
  Localiser localiser_;
  std::int64_t scans_ = 0;
  Instant heard_ = Instant::min();
  Pose2 truth_;
};

inline double off_m(const Localisation& found, const Pose2& truth) {
  return std::hypot(found.pose.x_m - truth.x_m, found.pose.y_m - truth.y_m);
}
inline double off_rad(const Localisation& found, const Pose2& truth) {
  return std::abs(wrap_angle(found.pose.yaw_rad - truth.yaw_rad));
}

}  // namespace tether::test
