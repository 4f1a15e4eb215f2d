#pragma once

#include "common/vehicle/pose.hpp"
#include "tools/can/operator.hpp"

namespace tether {

struct CanDriveOptions {
  Twist twist;
  double for_s = 10.0;
};

/// Commands one twist for a time (see TwistDrive) on the vehicle's command channel, stamped on the
/// bridge's clock, and prints distance and yaw by odometry. Returns 0 when it has been driven to
/// the end. Throws std::runtime_error with what went wrong, after zero commands.
int can_drive(const CanOperatorOptions& options, const CanDriveOptions& drive);

}  // namespace tether
