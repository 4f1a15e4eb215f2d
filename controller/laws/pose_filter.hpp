#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "common/base/counters.hpp"
#include "common/vehicle/motion_model.hpp"
#include "common/vehicle/pose.hpp"

namespace tether {

/// [controller.ekf]: what PoseFilter takes poses and vehicle for. Standard deviations.
struct PoseFilterSettings {
  double position_noise_m = 0.02;        ///< noise of a pose, each axis, white
  double yaw_noise_rad = 0.01;           ///< noise of a pose, white
  double position_drift_mpsqrts = 2e-3;  ///< random walk of each axis of the motion, after 1 s
  double yaw_drift_radpsqrts = 1e-3;     ///< random walk of the yaw, after 1 s
  double start_m = 0.02;                 ///< error of the start, each axis
  double start_rad = 0.01;
  double lag_ms = 0.0;  ///< lag of the drive; with adapt.lag: its first estimate
  /// Relative errors of the wheels' radius and of the track. Not set: 0.03 if anything is adapted,
  /// else 0.
  std::optional<double> radius_error = std::nullopt;
  std::optional<double> track_error = std::nullopt;
};

/// Travel of the wheels between two readings of their encoders, for the nominal wheels:
/// dead reckoning, in the frame of the pose at its beginning.
struct Rolled {
  double x_m = 0.0;
  double y_m = 0.0;
  double turn_rad = 0.0;
  double distance_m = 0.0;  ///< length of the path, not negative
  Twist at_end;
};

/// Rim speeds that the encoders say, against those that the commands would have led to, and the
/// derivatives of the latter by the lag.
struct LagReading {
  WheelSpeeds more;  ///< than predicted
  WheelSpeeds by_lag_mps2;
};

/// Which numbers of DriveModel are estimated with the pose. Those that are not stay as given.
struct Adaptation {
  bool radius = false;  ///< rim_scale, in ± PoseFilter::kMostScale of 1
  bool track = false;   ///< adapts turn_scale
  bool lag = false;     ///< lag_s, in [0, PoseFilter::kMostLag_s]
  bool bias = false;    ///< v_bias_mps and omega_bias_radps

  bool any() const { return radius || track || lag || bias; }
};

/// Estimates where a vehicle is from its commands and from poses that are noisy, late, lost or
/// wrong: an extended Kalman filter (Bar-Shalom, Li, Kirubarajan: Estimation with Applications to
/// Tracking and Navigation. Wiley, 2001, section 10.3).
///
/// The state is x, y, yaw; both rim speeds and what they aim at behind the lag; and the numbers of
/// DriveModel, as parameters that walk at random (section 11.9). It moves by MotionModel through
/// the commands that were in force, in steps of MotionModel::kShort_s at most; while wheels turn,
/// the pose drifts by position_drift and yaw_drift. A parameter that is not adapted stays. If its
/// error is given all the same (radius_error, track_error), or if another one is adapted, it is
/// *considered*: its covariance with the pose is kept, only its row of the gain is zero (Schmidt:
/// Application of State-Space Methods to Navigation Problems. In: Advances in Control Systems 3,
/// 1966; not consulted: any gain is right in Joseph's form, of which this is a special case). Else
/// it has no variance.
///
/// Where the wheels' encoders are heard (roll()), what they rolled takes the place of the commands.
///
/// A pose z is z = (x, y, yaw) + noise. Its innovation ν with covariance S gives the normalised
/// innovation squared, NIS = νᵀ S⁻¹ ν, which is χ² with 3 degrees of freedom if all is as assumed
/// (section 5.4). A pose of NIS > kGate, which happens to one in 1000, is gated: not used. After
/// kAgreeing gated poses in a row whose innovations agree with each other (the vehicle is elsewhere
/// and stays there), or kMostGated in a row that do not, the filter is reset: to that pose, with
/// the covariance of one pose; parameters stay.
///
/// Pure: no clock and no randomness. Poses come in the order of their stamps; the caller reports by
/// advance() the command in force between them.
class PoseFilter {
 public:
  static constexpr std::size_t kStates = 12;
  static constexpr double kGate = 16.266;       ///< 0.999 quantile of χ², 3 degrees of freedom
  static constexpr double kWheelGate = 13.816;  ///< the same of 2 degrees of freedom
  static constexpr int kAgreeing = 3;
  static constexpr int kMostGated = 6;
  // Bounds of parameters.
  static constexpr double kMostScale = 0.1;
  static constexpr double kMostLag_s = 0.5;
  static constexpr double kMostBias_mps = 0.3;
  static constexpr double kMostBias_radps = 0.1;

  enum class Verdict { accepted, gated, reset };
  using Covariance = std::array<double, kStates * kStates>;  ///< symmetric
  using Vector = std::array<double, kStates>;

  /// `limits`: of the vehicle.
  PoseFilter(const PoseFilterSettings& settings, const Adaptation& adapt,
             const MotionModel::Limits& limits, const Pose2& start);

  /// The vehicle moves on by `dt_s` ≥ 0 with `command` in force.
  void advance(const Twist& command, double dt_s);
  /// A pose measured now. It must be finite. `gates`: whether a pose of NIS > kGate is gated.
  Verdict update(const Pose2& measured, bool gates = true);
  /// How well a pose measured now would fit.
  struct Fit {
    double nis = 0.0;
    double log_likelihood = 0.0;  ///< up to a constant
  };
  Fit fit(const Pose2& measured) const;
  /// Uses a pose as update() does if it is accepted; counts nothing.
  void correct(const Pose2& measured);
  /// The vehicle moved on by what its wheels rolled in `dt_s`, whatever was commanded: scaled by
  /// what is known of wheels and track, with a variance of DeadReckoning::kVariancePerMetre for
  /// each wheel, errors of radius and track, and the drift, for slip.
  void roll(const Rolled& rolled, double dt_s);
  /// Comparison of the wheels' motion with the commands: tells the lag, if it is adapted. A reading
  /// beyond kWheelGate is not used.
  void update_lag(const LagReading& reading);
  /// The position is known less well, by this standard deviation more of each axis.
  void widen(double position_m);
  /// Forgets the pose: it is the measured one. The wheels turn as `rim` says.
  void restart(const Pose2& measured, const WheelSpeeds& rim);

  /// Takes state and covariance of the mixture of this filter and another one that has the share
  /// `share` in [0, 1] of it: mean and covariance of both together.
  void mix(const PoseFilter& other, double share);
  /// Takes state and covariance of another filter.
  void take(const PoseFilter& other);

  const MotionModel::State& state() const { return state_; }
  const MotionModel& model() const { return model_; }
  const Adaptation& adaptation() const { return adapt_; }
  /// Standing still, and told so.
  bool stands() const;

  /// Covariance of x, y, yaw, left rim, right rim, left aim, right aim, rim_scale, turn_scale,
  /// lag_s, v_bias_mps, omega_bias_radps.
  const Covariance& covariance() const { return covariance_; }
  Vector values() const;
  double standard_deviation(std::size_t i) const;

  double last_nis() const { return last_nis_; }
  /// Over all accepted poses; 0 before the first. 3 if all is as assumed.
  double mean_nis() const;
  std::int64_t accepted() const { return accepted_; }
  std::int64_t gated() const { return gated_; }
  std::int64_t rolled() const { return rolled_; }
  std::int64_t lag_readings() const { return lag_used_; }
  std::int64_t resets() const { return resets_; }

  /// Appends "ekf.accepted", "ekf.gated", "ekf.resets", with odometry "ekf.rolled" (ways
  /// between readings), "ekf.nis_per_mille" (the mean, of 3000 if all is as assumed), and what is
  /// adapted: "ekf.radius_ppm" (rim_scale − 1), "ekf.track_ppm" (turn_scale − 1), "ekf.lag_us",
  /// "ekf.bias_um_per_s", "ekf.bias_urad_per_s".
  void list_counters(CounterList& out) const;

  /// Derivative of the state after a step of `dt_s` ≤ kShort_s by the state before, row by row.
  /// `after` is what `model` makes of `before`.
  static Covariance jacobian(const MotionModel& model, const MotionModel::State& before,
                             const MotionModel::State& after, const Twist& command, double dt_s);

 private:
  struct Innovation;

  void correct(const Innovation& innovation);
  void step(const Twist& command, double dt_s);
  void set_values(const Vector& values);
  void add(const double* correction);  ///< one for each state
  void widen_by(double seconds);
  void widen_rolled(double distance_m, double direction_rad, double seconds);
  template <class Gain>
  void keep_considered(Gain& gain) const;
  bool agrees(const Pose2& innovation) const;
  void forget_pose(const Pose2& measured);

  PoseFilterSettings settings_;
  Adaptation adapt_;
  MotionModel model_;
  MotionModel::State state_;
  Covariance covariance_{};
  Pose2 last_gated_;  ///< its innovation
  int agreeing_ = 0;  ///< gated poses in a row that agree
  int in_a_row_ = 0;  ///< gated poses in a row
  double last_nis_ = 0.0;
  double sum_nis_ = 0.0;
  std::int64_t accepted_ = 0;
  std::int64_t gated_ = 0;
  std::int64_t rolled_ = 0;
  std::int64_t lag_used_ = 0;
  std::int64_t resets_ = 0;
};

}  // namespace tether
