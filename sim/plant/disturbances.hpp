#pragma once

#include <array>

#include "common/base/random.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {

/// Load on a wheel in addition to its servo and the floor.
struct WheelLoad {
  double up_N = 0.0;       ///< at the wheel's centre
  double forward_N = 0.0;  ///< at the wheel's centre, as it rolls
  double torque_Nm = 0.0;  ///< about its axle, between wheel and chassis; forward rolling positive
};
using WheelLoads = std::array<WheelLoad, 2>;  ///< left, right

/// Which way gravity pulls on a floor that rises by world.slope_x per metre along x and by
/// world.slope_y along y, in the floor's frame: −g (s_x, s_y, 1)/√(1 + s_x² + s_y²).
std::array<double, 3> gravity_on_slope_mps2(const WorldSettings& world);

/// Bumps that one wheel meets as it rolls: exponential ways between them, world.bump_spacing_m on
/// average from the end of one to the beginning of the next. So where they are depends on the seed
/// and the way only, not on the speed, and a vehicle that stands meets none.
///
/// A bump is a half sine, h(s) = H sin(π s/L) over the way s from 0 to L (world.bump_height_m,
/// world.bump_length_m). It does not lift the wheel's contact; it acts by forces:
/// - up: the momentum m v h'(0) = m v π H/L that the wheel gets where the bump begins, spread over
///   the bump as a half sine, F(s) = m v² π² H/(2 L²) sin(π s/L);
/// - forward: −(m g + F) h'(s). It holds back on the way up and pushes on the way down.
/// m is the wheel and half of the chassis with its load, v the present rim speed. This is a model
/// of our own, without springs, tyre deflection and what the bump's far edge does.
class Bumps {
 public:
  Bumps(const WorldSettings& world, double mass_kg, RandomEngine random);

  /// Load in a step of `dt_s` that begins with this rim speed.
  WheelLoad step(double rim_mps, double dt_s);

 private:
  double wait_m();

  WorldSettings world_;
  double mass_kg_;
  RandomEngine random_;
  double way_m_ = 0.0;
  double start_m_ = 0.0;  ///< start of the present or next bump
};

/// All that acts on the wheels: bumps, and drag that their encoders and the controller know nothing
/// of. Drag is a constant force at the rim against its motion (vehicle.left_drag_N, right_drag_N),
/// as of a brake or a tyre that rubs; never more in a step than half of what stops the bare wheel,
/// so that it does not turn it back.
class Disturbances {
 public:
  Disturbances(const VehicleConfig& vehicle, const WorldSettings& world, double step_s,
               RandomEngine random);

  /// Whether there is ever a load.
  bool any() const { return bumpy_ || drag_N_[0] > 0.0 || drag_N_[1] > 0.0; }
  /// The loads of the step that begins with these rim speeds.
  WheelLoads step(const WheelSpeeds& rim);

 private:
  double drag_torque(double drag_N, double rim_mps) const;

  double step_s_;
  double wheel_radius_m_;
  double wheel_inertia_kgm2_;
  std::array<double, 2> drag_N_;
  bool bumpy_;
  std::array<Bumps, 2> bumps_;
};

}  // namespace tether
