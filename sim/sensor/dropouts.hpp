#pragma once

#include <boost/random/exponential_distribution.hpp>

#include "common/base/random.hpp"
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

}  // namespace tether
