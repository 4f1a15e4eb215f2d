#pragma once

#include <deque>
#include <memory>

#include "common/path/reference_path.hpp"
#include "common/vehicle/motion_model.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/small_angle.hpp"
#include "controller/laws/law.hpp"
#include "controller/laws/network_estimate.hpp"

namespace tether {

/// Follows a moving reference point: its own twist as feedforward, and feedback of the errors in
/// the vehicle's frame,
///   x_e =  cos θ (x_r − x) + sin θ (y_r − y),   y_e = −sin θ (x_r − x) + cos θ (y_r − y),
///   θ_e = θ_r − θ.
/// The law of Kanayama et al. [1] is
///   v = v_r cos θ_e + K_x x_e,   ω = ω_r + v_r (K_y y_e + K_θ sin θ_e),
/// which is stable for all gains > 0 while v_r > 0; across the path, small errors decay like
/// s² + K_θ v_r s + K_y v_r², so K_θ = 2 √K_y is critically damped.
///
/// That law ignores the vehicle's limits: from rest, 13 m behind the path, it would overshoot or
/// spin. Hence two changes, which for small errors leave the law as it is, to first order:
/// - along the path, the speed of catching up is at most √(2 a (|x_e| − a/(2 K_x²))), from which
///   the acceleration limit a can brake in time ([2], section 3.9: the switching curve of the
///   double integrator), and K_x x_e below |x_e| = a/K_x²;
/// - across the path, it turns towards the point L = K_θ/K_y ahead of the reference on its tangent:
///   ω = ω_r + v_r K_θ α with α = atan2(y_e + L sin θ_e, L cos θ_e + max(x_e, 0)).
/// v and ω stay within the scenario's limits, and v·ω of catching up below max_lateral_mps2.
///
/// [1] Y. Kanayama, Y. Kimura, F. Miyazaki, T. Noguchi: A stable tracking control method for an
///     autonomous mobile robot. Proc. IEEE ICRA 1990, pp. 384–389.
/// [2] A. E. Bryson, Y.-C. Ho: Applied Optimal Control. Hemisphere, 1975.
class TrackingFeedback {
 public:
  /// `max_acceleration_mps2`: of the vehicle; catching up uses most of it.
  TrackingFeedback(const ControllerSettings& config, double max_acceleration_mps2);

  /// The twist for a vehicle at `pose` while the reference is at `reference`.
  Twist command(const Pose2& pose, const PathPoint& reference) const {
    return command(pose, Heading::of(pose.yaw_rad), reference);
  }
  /// The same where the pose's heading is known.
  Twist command(const Pose2& pose, const Heading& heading, const PathPoint& reference) const;

 private:
  double closing_speed(double x_e_m) const;

  TrackingGains gains_;
  double look_ahead_m_;
  double acceleration_mps2_;
  double linear_m_;  ///< |x_e| up to which the speed of catching up is K_x x_e
  double max_v_mps_;
  double max_omega_radps_;
};

/// The errors of a vehicle at `pose` to the reference point.
LawErrors errors_to(const Pose2& pose, const PathPoint& reference);

/// Whether they are below 1 cm and 10 mrad of the path's own heading.
bool is_on_path(const Pose2& pose, const PathPoint& reference);

/// The vehicle as controller.model.* and the scenario's vehicle have it.
MotionModel model_of(const LawSettings& settings);

/// Feedforward and feedback (TrackingFeedback) on the newest pose as if it were the present one.
class TrackingLaw final : public Law {
 public:
  explicit TrackingLaw(const LawContext& context);

  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawErrors errors() const override { return errors_; }

 private:
  std::shared_ptr<const ReferencePath> path_;
  TrackingFeedback feedback_;
  LawErrors errors_;
};

/// The same on the pose that the vehicle is predicted to have when the command arrives: from the
/// newest pose, through the commands sent. Each command is in force from its arrival, one delay of
/// the downlink after it was sent, until that of the next. The delay is assumed to be the median of
/// the last poses'. All commands are assumed to arrive: with much loss, the prediction is wrong
/// (PredictiveLaw mends that). Behind a filter that hears the wheels' odometry, the prediction
/// begins with what the wheels do, and each later command is mixed in by the share of poses that
/// arrive: the expected command, if commands are lost as often.
class CompensatedTrackingLaw final : public Law {
 public:
  explicit CompensatedTrackingLaw(const LawContext& context);

  void on_pose(const SeenPose& seen) override;
  LawOutput decide(Instant now, const SeenPose* newest) override;
  LawOutput stop(Instant now) override;
  LawErrors errors() const override { return errors_; }

 private:
  struct SentTwist {
    Instant when;
    Twist twist;
  };
  void remember(Instant now, const Twist& twist);
  MotionModel::State predict(const SeenPose& seen, Instant until) const;

  std::shared_ptr<const ReferencePath> path_;
  MotionModel model_;
  TrackingFeedback feedback_;
  DelayEstimate delay_;
  ReceptionEstimate reception_{100};
  Duration sensor_latency_;
  std::deque<SentTwist> sent_;
  LawErrors errors_;
};

}  // namespace tether
