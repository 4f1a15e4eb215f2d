#include "onboard/localiser/pose_tracker.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "common/vehicle/frames.hpp"
#include "onboard/localiser/scan_match.hpp"

namespace tether {
namespace {

// Assumed acceleration of a vehicle since the last reading.
constexpr double kAcceleration_mps2 = 1.0;
constexpr double kAcceleration_radps2 = 1.0;

// Lower bound of all information, 1/m², 1/(m rad) and 1/rad²: keeps sums from being singular.
constexpr double kNothing = 1e-6;

/// Effect of a motion of some covariance during a scan on its match (pose_tracker.hpp).
struct Bend {
  Eigen::Matrix3d noise;   ///< covariance of what it does to Λ z
  Eigen::Matrix3d before;  ///< covariance of the motion up to the scan's middle with that
  Eigen::Matrix3d after;   ///< covariance of the motion from there on with that
};

Bend bend_of(const Match& match, const Eigen::Matrix3d& motion) {
  constexpr std::size_t kHalf = Match::kSlices / 2;
  const Eigen::Matrix3d increment = motion / static_cast<double>(Match::kSlices);
  Bend bend{Eigen::Matrix3d::Zero(), {}, {}};
  const auto side = [&](const auto& slice_of) {
    Eigen::Matrix3d beyond = Eigen::Matrix3d::Zero(), sum = Eigen::Matrix3d::Zero();
    for (std::size_t i = kHalf; i-- > 0;) {  // from the end of this side to the middle
      const Eigen::Matrix3d here = matrix_of(match.by_time[slice_of(i)]);
      const Eigen::Matrix3d moved = beyond + 0.5 * here;
      bend.noise += moved * increment * moved;
      sum += moved;
      beyond += here;
    }
    return sum;
  };
  bend.after = increment * side([](std::size_t i) { return kHalf + i; });
  bend.before = -increment * side([](std::size_t i) { return kHalf - 1 - i; });
  return bend;
}

}  // namespace

/// By wheels that moved the vehicle by `step` on a way of this length.
void PoseTracker::roll(DeadReckoning& state, const Pose2& step, double distance_m) const {
  const double chord_m = std::copysign(std::hypot(step.x_m, step.y_m), step.x_m);
  const double half_m = 0.5 * settings_.track_m * step.yaw_rad;
  const double arc_m = std::copysign(distance_m, step.x_m);
  const double per_m = settings_.wheel_noise_m * settings_.wheel_noise_m;
  state.move({chord_m - half_m, chord_m + half_m, per_m * std::abs(arc_m - half_m),
              per_m * std::abs(arc_m + half_m)},
             settings_.track_m);
  state.covariance.add(-std::sin(state.pose.yaw_rad), std::cos(state.pose.yaw_rad), 0.0,
                       per_m * std::abs(arc_m));
}

void PoseTracker::move(const OdometryTrack::Point& from, const OdometryTrack::Point& to) {
  const Pose2 step = relative_to(from.pose, to.pose);
  const Pose2 before = state_.pose;
  roll(state_, step, to.distance_m - from.distance_m);
  state_.pose = compose(before, step);  // an arc only if the readings are close
  const double guess_s2 = 0.5 * to.beyond_s * to.beyond_s;
  const double along_m = kAcceleration_mps2 * guess_s2;
  state_.covariance.add(std::cos(state_.pose.yaw_rad), std::sin(state_.pose.yaw_rad), 0.0,
                        along_m * along_m);
  const double turn_rad = kAcceleration_radps2 * guess_s2;
  state_.covariance.add(0.0, 0.0, 1.0, turn_rad * turn_rad);
  state_.covariance =
      covariance_from(matrix_of(state_.covariance) - known_ahead_ - known_ahead_.transpose());
  known_ahead_.setZero();
}

void PoseTracker::widen(double position_m, double yaw_rad) {
  state_.covariance.add(1.0, 0.0, 0.0, position_m * position_m);
  state_.covariance.add(0.0, 1.0, 0.0, position_m * position_m);
  state_.covariance.add(0.0, 0.0, 1.0, yaw_rad * yaw_rad);
  known_ahead_.setZero();
}

bool PoseTracker::correct(const Match& match, const OdometryTrack::Point& began,
                          const OdometryTrack::Point& ended) {
  const Eigen::Matrix3d p = matrix_of(state_.covariance);
  DeadReckoning meanwhile{state_.pose, {}, 0.0};
  roll(meanwhile, relative_to(began.pose, ended.pose), ended.distance_m - began.distance_m);
  const Eigen::Matrix3d says = matrix_of(match.information);
  const Bend bend = bend_of(match, matrix_of(meanwhile.covariance));
  const Eigen::Vector3d innovation =
      says * Eigen::Vector3d(match.pose.x_m - state_.pose.x_m, match.pose.y_m - state_.pose.y_m,
                             wrap_angle(match.pose.yaw_rad - state_.pose.yaw_rad));
  const Eigen::Matrix3d crossed = says * bend.before;
  const Eigen::Matrix3d spread = says * p * says + crossed + crossed.transpose() + says +
                                 bend.noise + kNothing * Eigen::Matrix3d::Identity();
  const Eigen::LDLT<Eigen::Matrix3d> solver(spread);
  last_nis_ = innovation.dot(solver.solve(innovation));
  if (!(last_nis_ <= kGate)) return false;
  const Eigen::Matrix3d gain = solver.solve((p * says + bend.before).transpose()).transpose();
  const Eigen::Matrix3d after = p - gain * spread * gain.transpose();
  known_ahead_ = gain * bend.after.transpose();
  const Eigen::Vector3d step = gain * innovation;
  state_.pose = {state_.pose.x_m + step.x(), state_.pose.y_m + step.y(),
                 wrap_angle(state_.pose.yaw_rad + step.z())};
  state_.covariance = covariance_from(0.5 * (after + after.transpose()));
  return true;
}

double PoseTracker::position_sigma_m() const {
  const PoseCovariance& p = state_.covariance;
  const double middle = 0.5 * (p.x_x + p.y_y);
  return std::sqrt(middle + std::hypot(0.5 * (p.x_x - p.y_y), p.x_y));
}

}  // namespace tether
