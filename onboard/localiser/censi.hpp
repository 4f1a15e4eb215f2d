#pragma once

#include <span>

#include "common/vehicle/pose.hpp"
#include "onboard/localiser/scan_match.hpp"

namespace tether {

/// A beam of a perfect scanner, world frame.
struct SeenOutline {
  double direction_rad = 0.0;  ///< direction of the beam
  double range_m = 0.0;
  double normal_rad = 0.0;  ///< direction of the outline's normal where the beam ends
};

/// Upper bound of a scan's information on the vehicle's pose: Fisher's information, whose inverse
/// is the Cramér-Rao bound of the covariance of any unbiased estimate. Censi, On achievable
/// accuracy for range-finder localization. ICRA 2007: with v the outline's normal, β the angle of
/// incidence, r the range and σ its standard deviation,
///
///     I = σ⁻² Σ [ v vᵀ/cos²β,  r (tan β/cos β) v ;  ·,  r² tan²β ]
///
/// for a scanner at the vehicle's reference point; one that is mounted elsewhere moves with the
/// yaw. `mount`: of the scanner in the vehicle's frame; `yaw_rad`: of the vehicle.
PoseInformation censi_information(std::span<const SeenOutline> beams, double sigma_m,
                                  double yaw_rad = 0.0, const Pose2& mount = {});

}  // namespace tether
