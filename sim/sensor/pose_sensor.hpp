#pragma once

#include <boost/random/exponential_distribution.hpp>
#include <boost/random/normal_distribution.hpp>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>

#include "common/base/random.hpp"
#include "common/base/time.hpp"
#include "common/vehicle/pose.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

/// Times without measurements: they begin at a constant rate while there are some
/// (sensor.dropouts_per_min; at the first there are) and last exponentially long, sensor.dropout_s
/// on average. In the long run the share dropout_s / (dropout_s + 60 s / dropouts_per_min) is
/// missing.
class Dropouts {
 public:
  Dropouts(const SensorSettings& config, RandomEngine random)
      : per_s_(config.dropouts_per_min / 60.0), mean_s_(config.dropout_s), random_(random) {}

  /// Whether the measurement at `t_s` seconds after the first is missing; times must not decrease.
  bool at(double t_s) {
    if (per_s_ == 0.0) return false;
    while (end_s_ <= t_s) {
      start_s_ = end_s_ + exponential(1.0 / per_s_);
      end_s_ = start_s_ + exponential(mean_s_);
    }
    return start_s_ <= t_s;
  }

 private:
  double exponential(double mean_s) {
    return mean_s * boost::random::exponential_distribution<double>()(random_);
  }

  double per_s_;
  double mean_s_;
  RandomEngine random_;
  double start_s_ = 0.0;  ///< start of the present or next dropout
  double end_s_ = 0.0;
};

/// Noise of unit variance whose correlation falls by e in `correlation_s`, sampled at `rate_hz`:
/// the first-order Gauss–Markov process
///   e_0 = w_0,   e_n = a e_{n−1} + √(1 − a²) w_n,   a = exp(−1/(rate · correlation time)),
/// with w white of unit variance. It is stationary from the first sample on: each has the variance
/// of w, and samples k apart have the correlation a^k. correlation_s = 0: e = w, to the bit.
class GaussMarkov {
 public:
  GaussMarkov(double correlation_s, double rate_hz)
      : keep_(correlation_s > 0.0 ? std::exp(-1.0 / (rate_hz * correlation_s)) : 0.0),
        renew_(std::sqrt(1.0 - keep_ * keep_)) {}

  double next(double white) {
    value_ = any_ ? keep_ * value_ + renew_ * white : white;
    any_ = true;
    return value_;
  }

 private:
  double keep_;
  double renew_;
  double value_ = 0.0;
  bool any_ = false;
};

/// Errors of a localisation that takes another place for the right one. Jumps come as a Poisson
/// process in time (sensor.jumps_per_min, from the first measurement on). Each replaces the error
/// before by a new one, normal with sensor.jump_m in x and y and sensor.jump_rad in yaw, which
/// holds until the next jump, or for sensor.jump_s if that comes first.
class LocalisationJumps {
 public:
  LocalisationJumps(const SensorSettings& config, RandomEngine random)
      : config_(config), random_(random), next_s_(config.jumps_per_min > 0.0 ? wait_s() : kNever) {}

  /// The error of the measurement at `t_s` seconds after the first; times must not decrease.
  Pose2 at(double t_s) {
    while (next_s_ <= t_s) {
      error_.x_m = config_.jump_m * normal_(random_);
      error_.y_m = config_.jump_m * normal_(random_);
      error_.yaw_rad = config_.jump_rad * normal_(random_);
      end_s_ = config_.jump_s > 0.0 ? next_s_ + config_.jump_s : kNever;
      next_s_ += wait_s();
    }
    return t_s < end_s_ ? error_ : Pose2{};
  }

 private:
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  double wait_s() {
    return 60.0 / config_.jumps_per_min *
           boost::random::exponential_distribution<double>()(random_);
  }

  SensorSettings config_;
  RandomEngine random_;
  boost::random::normal_distribution<double> normal_;
  Pose2 error_;
  double next_s_;  ///< the next jump
  double end_s_ = 0.0;
};

/// Which of the measured poses are sent with sensor.send = "changed": send-on-delta (Miskowicz:
/// Send-On-Delta Concept: An Event-Based Data Reporting Strategy. Sensors 6, 2006). A pose says
/// nothing of speed, so until the next one the receiver can but hold it; one is sent if it is
/// farther than sensor.send_delta_m, or turned by more than sensor.send_delta_rad, from the last
/// one that was, and else so early that no two are further apart than sensor.send_max_age_s. What
/// became of those that were sent it does not know: a lost one is made good for by the next.
class PoseSending {
 public:
  explicit PoseSending(const SensorSettings& settings)
      : delta_m_(settings.send_delta_m),
        delta_rad_(settings.send_delta_rad),
        max_age_(from_seconds(settings.send_max_age_s)),
        period_(from_seconds(1.0 / settings.rate_hz)) {}

  /// Whether the pose that was measured at `now`, which goes up, is to be sent; then it counts as
  /// sent.
  bool is_due(Instant now, const Pose2& measured) {
    ++sampled_;
    if (last_ && now + period_ - last_->at <= max_age_ && !differs(measured)) return false;
    last_ = {measured, now};
    ++sent_;
    return true;
  }

  std::int64_t sampled() const { return sampled_; }
  std::int64_t sent() const { return sent_; }

 private:
  struct Sent {
    Pose2 pose;
    Instant at;
  };
  bool differs(const Pose2& pose) const {
    return std::hypot(pose.x_m - last_->pose.x_m, pose.y_m - last_->pose.y_m) > delta_m_ ||
           std::abs(wrap_angle(pose.yaw_rad - last_->pose.yaw_rad)) > delta_rad_;
  }

  double delta_m_, delta_rad_;
  Duration max_age_, period_;
  std::optional<Sent> last_;
  std::int64_t sampled_ = 0, sent_ = 0;
};

/// Turns the true pose into a measured one. Its errors in x, y and yaw are the sum of
/// - Gaussian noise, white or correlated (GaussMarkov);
/// - a constant bias;
/// - a random walk, as odometry without a reference drifts; it begins at 0 with the first
///   measurement;
/// - that of the last jump (LocalisationJumps);
/// and at times there is no measurement (Dropouts). The n-th measurement's errors depend on the
/// seed and n only: each kind has a random stream of its own, and all are drawn whether or not they
/// are used.
class PoseSensor {
 public:
  /// The streams are "<vehicle>/sensor/pose", …/drift, …/jumps and …/dropouts of the run's seed.
  PoseSensor(const SensorSettings& config, std::uint64_t seed, const std::string& vehicle);

  /// The next measurement; nullopt if there is none.
  std::optional<Pose2> measure(const Pose2& truth);

 private:
  void walk();

  SensorSettings config_;
  RandomEngine random_;
  boost::random::normal_distribution<double> normal_;
  GaussMarkov x_noise_, y_noise_, yaw_noise_;
  RandomEngine drift_random_;
  boost::random::normal_distribution<double> drift_normal_;
  Pose2 drift_;
  LocalisationJumps jumps_;
  Dropouts dropouts_;
  std::int64_t count_ = 0;
};

}  // namespace tether
