#include "sim/plant/disturbances.hpp"

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

/// The wheel and half of the chassis with what it carries.
double mass_at_wheel_kg(const VehicleConfig& v) {
  return v.wheel_mass_kg + 0.5 * (v.chassis_mass_kg + v.caster_mass_kg + v.payload_kg);
}

}  // namespace

std::array<double, 3> gravity_on_slope_mps2(const WorldSettings& world) {
  if (world.slope_x == 0.0 && world.slope_y == 0.0) return {0.0, 0.0, -world.gravity_mps2};
  const double share = world.gravity_mps2 / std::hypot(1.0, world.slope_x, world.slope_y);
  return {-share * world.slope_x, -share * world.slope_y, -share};
}

Bumps::Bumps(const WorldSettings& world, double mass_kg, RandomEngine random)
    : world_(world), mass_kg_(mass_kg), random_(random) {
  if (world_.bump_spacing_m > 0.0) start_m_ = wait_m();
}

double Bumps::wait_m() {
  return world_.bump_spacing_m * boost::random::exponential_distribution<double>()(random_);
}

WheelLoad Bumps::step(double rim_mps, double dt_s) {
  using std::numbers::pi;
  way_m_ += std::abs(rim_mps) * dt_s;
  const double length_m = world_.bump_length_m;
  while (way_m_ > start_m_ + length_m) start_m_ += length_m + wait_m();
  if (way_m_ < start_m_) return {};
  const double phase = pi * (way_m_ - start_m_) / length_m;
  const double slope = pi * world_.bump_height_m / length_m * std::cos(phase);
  const double up_N = mass_kg_ * rim_mps * rim_mps * pi * pi * world_.bump_height_m /
                      (2.0 * length_m * length_m) * std::sin(phase);
  const double back_N = (mass_kg_ * world_.gravity_mps2 + up_N) * slope;
  // A wheel that stands on a bump is held by its servo; what pushes it is left out.
  if (rim_mps == 0.0) return {};
  return {.up_N = up_N, .forward_N = rim_mps > 0.0 ? -back_N : back_N, .torque_Nm = 0.0};
}

Disturbances::Disturbances(const VehicleConfig& vehicle, const WorldSettings& world, double step_s,
                           RandomEngine random)
    : step_s_(step_s),
      wheel_radius_m_(vehicle.wheel_radius_m),
      wheel_inertia_kgm2_(0.5 * vehicle.wheel_mass_kg * vehicle.wheel_radius_m *
                          vehicle.wheel_radius_m),
      drag_N_{vehicle.left_drag_N, vehicle.right_drag_N},
      bumpy_(world.bump_spacing_m > 0.0),
      bumps_{Bumps(world, mass_at_wheel_kg(vehicle), RandomEngine(random())),
             Bumps(world, mass_at_wheel_kg(vehicle), RandomEngine(random()))} {}

WheelLoads Disturbances::step(const WheelSpeeds& rim) {
  WheelLoads loads;
  if (bumpy_)
    loads = {bumps_[0].step(rim.left_mps, step_s_), bumps_[1].step(rim.right_mps, step_s_)};
  loads[0].torque_Nm = drag_torque(drag_N_[0], rim.left_mps);
  loads[1].torque_Nm = drag_torque(drag_N_[1], rim.right_mps);
  return loads;
}

double Disturbances::drag_torque(double drag_N, double rim_mps) const {
  const double half_stop_Nm =
      0.5 * wheel_inertia_kgm2_ * std::abs(rim_mps) / (wheel_radius_m_ * step_s_);
  return -std::copysign(std::min(drag_N * wheel_radius_m_, half_stop_Nm), rim_mps);
}

}  // namespace tether
