#pragma once

#include "common/base/random.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// The vehicle as it really stands: its start pose off the nominal one, which is all that the
/// controller, the plans and the odometry know, by vehicle.start_error_m in x and in y and
/// vehicle.start_error_rad in yaw. Each of the three is normal, drawn again while it is beyond
/// kStartErrorSigmas standard deviations: 0.27 % are, and what is left has 0.987 of the deviation.
/// Of one state of `random`, the errors are proportional to the deviations: scenarios that differ
/// in these alone have the same luck.
VehicleSettings at_true_start(const VehicleSettings& vehicle, RandomEngine random);

}  // namespace tether
