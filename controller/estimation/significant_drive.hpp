#pragma once

#include "common/vehicle/motion_model.hpp"
#include "controller/estimation/pose_filter.hpp"

namespace tether {

/// The drive as a law should take it: of what the filter found, what is significant.
///
/// An estimate with nothing to find is noise, and a law that acts on it is worse than one that does
/// not. So of the difference d from what was given, with standard deviation σ, a law uses
///   d · max(0, 1 − (2σ/d)⁴):
/// nothing below 2 σ, 80 % at 3 σ, 97 % at 5 σ. (A threshold as in wavelet shrinkage; the power is
/// ours.) A lag that turns out shorter is believed at once: a lead that is too small does no harm.
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
  drive.lag_s = found.lag_s < given.lag_s ? found.lag_s : use(found.lag_s, given.lag_s, 9);
  drive.v_bias_mps = use(found.v_bias_mps, given.v_bias_mps, 10);
  drive.omega_bias_radps = use(found.omega_bias_radps, given.omega_bias_radps, 11);
  return drive;
}

}  // namespace tether
