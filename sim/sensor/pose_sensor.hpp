#pragma once

#include <boost/random/normal_distribution.hpp>
#include <cstdint>
#include <optional>
#include <string>

#include "common/base/random.hpp"
#include "common/vehicle/pose.hpp"
#include "sim/sensor/dropouts.hpp"
#include "sim/sensor/gauss_markov.hpp"
#include "sim/sensor/localisation_jumps.hpp"
#include "sim/sensor/sensor_settings.hpp"

namespace tether {

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
