#pragma once

#include <algorithm>

#include "common/vehicle/motion_model.hpp"
#include "controller/estimation/pose_filter.hpp"

namespace tether {

/// The drive as a law should take it: of what the filter found, what is significant.
///
/// An estimate with nothing to find is noise, and a law that acts on it is worse than one that does
/// not. So of the difference d from what was given, with standard deviation σ, a law uses
///   d · max(0, 1 − (2σ/d)⁴):
/// nothing below 2 σ, 80 % at 3 σ, 97 % at 5 σ. (A threshold as in wavelet shrinkage; the power is
/// ours.) Of a lag that is
/// adapted it uses what is almost sure, the estimate less σ: a lead that is too small costs little,
/// one for a lag that is not there makes wheels slip.
inline DriveModel significant_drive(const PoseFilter& filter, const DriveModel& given) {
  const DriveModel& found = filter.model().drive();
  const auto use = [&](double value, double from, std::size_t state) {
    const double d = value - from;
    const double limit = 2.0 * filter.standard_deviation(state);
    if (d * d <= limit * limit) return from;
    const double share = limit * limit / (d * d);
    return from + d * (1.0 - share * share);
  };
  DriveModel drive;
  drive.rim_scale = use(found.rim_scale, given.rim_scale, 7);
  drive.turn_scale = use(found.turn_scale, given.turn_scale, 8);
  const bool adapts = filter.adaptation().lag;
  drive.lag_s = adapts ? std::max(0.0, found.lag_s - filter.standard_deviation(9)) : given.lag_s;
  drive.v_bias_mps = use(found.v_bias_mps, given.v_bias_mps, 10);
  drive.omega_bias_radps = use(found.omega_bias_radps, given.omega_bias_radps, 11);
  return drive;
}

}  // namespace tether
