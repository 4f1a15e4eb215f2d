#pragma once

#include "common/base/time.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

/// One wheel with its speed servo, where no simulator turns the wheels: an inertia, a servo whose
/// torque is limited and lags, and Coulomb friction. A pure model; SI units.
///
/// torque demand = gain · (target − speed), within ±max_torque; torque follows it with time
/// constant lag (first order); friction opposes motion and holds a standing wheel. Under constant
/// friction the speed stays friction/gain behind its target.
class WheelModel {
 public:
  struct Config {
    double inertia_kgm2 = 0.35;
    double max_torque_Nm = 4.0;
    double friction_Nm = 0.1;
    double lag_s = 0.002;
    double gain_Nms = 44.0;  ///< torque per speed error
  };

  /// Half of `vehicle`'s mass at the rim and a solid disc for the wheel; its torque limit; the gain
  /// that makes servo and lag critically damped, inertia / (4 lag).
  static Config of(const VehicleConfig& vehicle);

  /// Stands still at angle 0.
  explicit WheelModel(const Config& config) : config_(config) {}

  /// Semi-implicit Euler in steps of at most 1 ms.
  void step(double target_radps, Duration dt);

  double angle_rad() const { return angle_rad_; }
  double speed_radps() const { return speed_radps_; }
  double torque_nm() const { return torque_Nm_; }

 private:
  void substep(double target_radps, double dt_s);

  Config config_;
  double angle_rad_ = 0.0;
  double speed_radps_ = 0.0;
  double torque_Nm_ = 0.0;
};

}  // namespace tether
