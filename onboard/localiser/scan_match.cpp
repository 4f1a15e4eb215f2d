#include "onboard/localiser/scan_match.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/vehicle/frames.hpp"

namespace tether {
namespace {

/// Number of beams between two computed places of the scanner; in between it moves straight.
constexpr std::size_t kSpan = 32;

/// Pose of the scanner at a beam's time, in the vehicle's frame when it was at `then` by odometry.
Pose2 scanner_at(const Scan& scan, const OdometryTrack& odometry, const Pose2& then,
                 std::size_t beam) {
  if (odometry.empty()) return scan.mount;
  return compose(relative_to(then, odometry.at(scan.time_of(beam))->pose), scan.mount);
}

}  // namespace

std::vector<Beam> beams_of(const Scan& scan, const OdometryTrack& odometry, Instant when,
                           std::size_t most) {
  const std::size_t count = scan.range_m.size();
  const std::size_t chosen = std::min(most, count);
  const Pose2 then = odometry.empty() ? Pose2{} : odometry.at(when)->pose;
  std::vector<Beam> beams;
  beams.reserve(chosen);
  Pose2 from, to;
  std::size_t span = count;  // none yet
  for (std::size_t k = 0; k < chosen; ++k) {
    const std::size_t i = k * count / chosen;
    const double range_m = scan.range_m[i];
    if (range_m <= 0.0 || range_m < scan.range_min_m || range_m > scan.range_max_m) continue;
    if (i / kSpan != span) {
      span = i / kSpan;
      from = scanner_at(scan, odometry, then, span * kSpan);
      to = scanner_at(scan, odometry, then, (span + 1) * kSpan);
    }
    const double share = static_cast<double>(i % kSpan) / kSpan;
    const double angle_rad =
        scan.angle_rad(i) + from.yaw_rad + share * wrap_angle(to.yaw_rad - from.yaw_rad);
    const double c = std::cos(angle_rad), s = std::sin(angle_rad);
    beams.push_back({static_cast<float>(from.x_m + share * (to.x_m - from.x_m) + range_m * c),
                     static_cast<float>(from.y_m + share * (to.y_m - from.y_m) + range_m * s),
                     static_cast<float>(c), static_cast<float>(s),
                     static_cast<float>(i) / static_cast<float>(count)});
  }
  return beams;
}

namespace {

/// Information on the yaw from another source (odometry): 0.2 rad. Else a position beside a
/// circle's centre would be unknown wherever the yaw is.
constexpr double kOtherwise = 25.0;

double sigma_of(double information) {
  constexpr double kLeast = 1.0 / (Weakness::kNothing * Weakness::kNothing);
  return 1.0 / std::sqrt(std::max(information, kLeast));
}

/// Information `of` that remains if the same measurement also estimates the rest.
double left_of(double of, double coupling, double rest) {
  return rest > 0.0 ? of - coupling * coupling / rest : of;
}

}  // namespace

Weakness weakness(const PoseInformation& information) {
  const Eigen::Matrix3d all = matrix_of(information);
  Eigen::Matrix2d position = all.topLeftCorner<2, 2>();
  const Eigen::Vector2d coupling = all.topRightCorner<2, 1>();
  const double yaw = all(2, 2);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> known(position);
  double yaw_left = yaw;
  for (int i = 0; i < 2; ++i) {
    yaw_left = left_of(yaw_left, known.eigenvectors().col(i).dot(coupling), known.eigenvalues()(i));
  }
  position -= coupling * coupling.transpose() / (yaw + kOtherwise);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> left(position);
  const Eigen::Vector2d weak = left.eigenvectors().col(0);
  double direction_rad = std::atan2(weak.y(), weak.x());
  if (direction_rad <= -0.5 * std::numbers::pi) direction_rad += std::numbers::pi;
  if (direction_rad > 0.5 * std::numbers::pi) direction_rad -= std::numbers::pi;
  return {direction_rad, sigma_of(left.eigenvalues()(0)), sigma_of(yaw_left)};
}

PoseCovariance covariance_of(const PoseInformation& information) {
  return covariance_from(matrix_of(information).inverse());
}

namespace {

constexpr double kTukey = 4.685;
constexpr double kEfficiency = 0.95;
/// Mean of squares that are weighed so, of normal noise: (1 − 6/c² + 15/c⁴)/(1 − 2/c² + 3/c⁴).
constexpr double kMeanSquare = 0.828;
constexpr int kMostSteps = 12;      ///< at the noise's own scale
constexpr int kStepsEachScale = 3;  ///< at most, before
// Damping: a step's own standard deviation, which keeps it small where beams say nothing.
constexpr double kDamped_m = 0.1;
constexpr double kDamped_rad = 0.03;
// No step is longer than this.
constexpr double kLongest_m = 0.5;
constexpr double kLongest_rad = 0.2;
// Steps this small are the last; steps that are smaller than this share of the scale, at that
// scale.
constexpr double kSmallShare = 0.2;
constexpr double kArm_m = 10.0;  ///< turns a yaw's step into metres
constexpr double kLast_m = 1e-4;
constexpr double kLast_rad = 1e-5;

/// Sums over all beams.
struct Sums {
  PoseInformation information;
  std::array<PoseInformation, Match::kSlices> by_time{};  ///< if that is the purpose
  Eigen::Vector3d slope = Eigen::Vector3d::Zero();
  double weights = 0.0;          ///< Tukey's
  double weighed_squares = 0.0;  ///< sum of squared distances over standard deviations
  double squares_m2 = 0.0;
  int used = 0;
};

/// Purpose of the weights: the next step, or what is known then, where all beams that fit have the
/// same weight.
enum class Purpose { step, information };

/// With `wider_m` more standard deviation than the noise.
Sums sum_up(const DistanceField& field, std::span<const Beam> beams, const Pose2& pose,
            const MatchSettings& settings, double wider_m, Purpose purpose = Purpose::step) {
  const auto c = static_cast<float>(std::cos(pose.yaw_rad));
  const auto s = static_cast<float>(std::sin(pose.yaw_rad));
  const auto x_m = static_cast<float>(pose.x_m), y_m = static_cast<float>(pose.y_m);
  const double across_m2 = settings.map_noise_m * settings.map_noise_m + wider_m * wider_m;
  const double along_m2 = settings.range_noise_m * settings.range_noise_m;
  Sums sums;
  for (const Beam& beam : beams) {
    const float arm_x_m = c * beam.x_m - s * beam.y_m, arm_y_m = s * beam.x_m + c * beam.y_m;
    const DistanceField::Value end = field.at(x_m + arm_x_m, y_m + arm_y_m);
    const double by_x = end.by_x, by_y = end.by_y, distance_m = end.distance_m;
    const double cosine =
        by_x * (c * beam.along_x - s * beam.along_y) + by_y * (s * beam.along_x + c * beam.along_y);
    const double variance_m2 = across_m2 + along_m2 * cosine * cosine;
    const double squared = distance_m * distance_m / variance_m2;
    if (squared >= kTukey * kTukey) continue;
    const double rest = 1.0 - squared / (kTukey * kTukey);
    const double tukey = rest * rest;
    const double by_yaw_m = by_y * arm_x_m - by_x * arm_y_m;
    if (purpose == Purpose::information) {
      const auto slice = static_cast<std::size_t>(beam.share * Match::kSlices);
      sums.by_time[std::min(slice, Match::kSlices - 1)].add(by_x, by_y, by_yaw_m,
                                                            kEfficiency / variance_m2);
    }
    const double weight = tukey / variance_m2;
    sums.information.add(by_x, by_y, by_yaw_m, weight);
    sums.slope += weight * distance_m * Eigen::Vector3d(by_x, by_y, by_yaw_m);
    sums.weights += tukey;
    sums.weighed_squares += tukey * squared;
    sums.squares_m2 += distance_m * distance_m;
    ++sums.used;
  }
  return sums;
}

Eigen::Vector3d step_of(const Sums& sums) {
  Eigen::Matrix3d damped = matrix_of(sums.information);
  damped.diagonal() += Eigen::Vector3d(1.0 / (kDamped_m * kDamped_m), 1.0 / (kDamped_m * kDamped_m),
                                       1.0 / (kDamped_rad * kDamped_rad));
  Eigen::Vector3d step = -damped.ldlt().solve(sums.slope);
  const double too_long =
      std::max(step.head<2>().norm() / kLongest_m, std::abs(step.z()) / kLongest_rad);
  if (too_long > 1.0) step /= too_long;
  return step;
}

struct Size {
  double m, rad;
};

Size take_step(const Sums& sums, Pose2& pose) {
  const Eigen::Vector3d step = step_of(sums);
  pose = {pose.x_m + step.x(), pose.y_m + step.y(), wrap_angle(pose.yaw_rad + step.z())};
  return {step.head<2>().norm(), std::abs(step.z())};
}

Match match_from(const Sums& sums, const Pose2& pose, std::size_t beams, int passes) {
  Match match;
  match.passes = passes;
  match.pose = pose;
  match.used = sums.used;
  match.outside = static_cast<int>(beams) - sums.used;
  if (sums.used == 0) return match;
  match.fit = sums.weights / static_cast<double>(beams);
  match.residual_m = std::sqrt(sums.squares_m2 / sums.used);
  const double excess = std::max(1.0, sums.weighed_squares / sums.weights / kMeanSquare);
  Eigen::Matrix3d all = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < Match::kSlices; ++i) {
    const Eigen::Matrix3d slice = matrix_of(sums.by_time[i]) / excess;
    match.by_time[i] = covariance_from(slice);
    all += slice;
  }
  match.information = covariance_from(all);
  return match;
}

}  // namespace

Match match_scan(const DistanceField& field, std::span<const Beam> beams, const Pose2& guess,
                 const MatchSettings& settings) {
  Pose2 pose = guess;
  int passes = 0;
  for (double wider_m = settings.max_distance_m / kTukey; wider_m > 0.5 * settings.range_noise_m;
       wider_m *= 0.5) {
    for (int i = 0; i < kStepsEachScale; ++i) {
      const Size step = take_step(sum_up(field, beams, pose, settings, wider_m), pose);
      ++passes;
      if (step.m + kArm_m * step.rad < kSmallShare * wider_m) break;
    }
  }
  for (int i = 0; i < kMostSteps; ++i) {
    const Size step = take_step(sum_up(field, beams, pose, settings, 0.0), pose);
    ++passes;
    if (step.m < kLast_m && step.rad < kLast_rad) break;
  }
  const Sums last = sum_up(field, beams, pose, settings, 0.0, Purpose::information);
  return match_from(last, pose, beams.size(), passes + 1);
}

int beams_through_map(const DistanceField& field, std::span<const Beam> beams, const Pose2& pose,
                      double max_distance_m) {
  constexpr double kTouching_m = 0.03;
  const double c = std::cos(pose.yaw_rad), s = std::sin(pose.yaw_rad);
  return static_cast<int>(std::ranges::count_if(beams, [&](const Beam& beam) {
    const double along_x = c * beam.along_x - s * beam.along_y;
    const double along_y = s * beam.along_x + c * beam.along_y;
    const double end_x_m = pose.x_m + c * beam.x_m - s * beam.y_m;
    const double end_y_m = pose.y_m + s * beam.x_m + c * beam.y_m;
    const double range_m = beam.x_m * beam.along_x + beam.y_m * beam.along_y;
    // From the vehicle on, as far at a time as the map is known to be free.
    for (double rest_m = range_m; rest_m > max_distance_m;) {
      const double free_m = field
                                .at(static_cast<float>(end_x_m - rest_m * along_x),
                                    static_cast<float>(end_y_m - rest_m * along_y))
                                .distance_m;
      if (free_m < kTouching_m) return true;
      rest_m -= free_m;
    }
    return false;
  }));
}

}  // namespace tether
