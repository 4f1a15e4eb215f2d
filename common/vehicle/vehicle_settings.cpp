#include "common/vehicle/vehicle_settings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"

namespace tether {
namespace {

using World = WorldSettings;
using Vehicle = VehicleSettings;

constexpr Range kMass{1e-3, 1e5, false};
constexpr Range kOffset{-100.0, 100.0, false};
constexpr Range kFriction{0.0, 100.0, false};

void add_body(KeyTable<Vehicle>& t) {
  t.number("chassis_length_m", &Vehicle::chassis_length_m, kLength, "chassis box along x");
  t.number("chassis_width_m", &Vehicle::chassis_width_m, kLength, "chassis box along y");
  t.number("chassis_height_m", &Vehicle::chassis_height_m, kLength, "chassis box along z");
  t.number("chassis_mass_kg", &Vehicle::chassis_mass_kg, kMass, "chassis box without caster");
  t.number("chassis_z_m", &Vehicle::chassis_z_m, {-1.0, 10.0, false},
           "chassis centre above the drive axle");
  t.number("wheel_radius_m", &Vehicle::wheel_radius_m, kLength, "drive wheels");
  t.number("wheel_width_m", &Vehicle::wheel_width_m, kLength, "drive wheels");
  t.number("wheel_mass_kg", &Vehicle::wheel_mass_kg, kMass, "each drive wheel");
  t.number("track_m", &Vehicle::track_m, kLength, "between the wheels' centres");
  t.number("axle_x_m", &Vehicle::axle_x_m, kOffset, "drive axle, relative to the chassis centre");
  t.number("caster_x_m", &Vehicle::caster_x_m, kOffset,
           "caster ball, relative to the chassis centre");
  t.number("caster_radius_m", &Vehicle::caster_radius_m, kLength, "caster ball");
  t.number("caster_mass_kg", &Vehicle::caster_mass_kg, kMass, "caster ball");
  t.number("max_wheel_torque_Nm", &Vehicle::max_wheel_torque_Nm, kPositive,
           "torque limit of each wheel's speed servo");
  t.number("max_wheel_acceleration_mps2", &Vehicle::max_wheel_acceleration_mps2, kPositive,
           "slew rate of each wheel's rim speed");
  t.number("max_wheel_speed_mps", &Vehicle::max_wheel_speed_mps, kPositive,
           "rim speed limit; both wheels are scaled together");
}

void add_tyres(KeyTable<Vehicle>& t) {
  t.boolean("anti_windup", &Vehicle::anti_windup,
            "stop all wheels' targets from running ahead of a wheel whose motor is at "
            "max_wheel_torque_Nm");
  t.choice<Vehicle::Tyre>("tyre", &Vehicle::tyre,
                          {{"rigid", Vehicle::Tyre::rigid}, {"brush", Vehicle::Tyre::brush}},
                          "roll without slip up to the limit of friction, or slip as brushes do");
  t.number("tyre_stiffness", &Vehicle::tyre_stiffness, {1.0, 1000.0, false},
           "tyre = brush: force per load and slip, below sliding");
  t.number("tyre_relaxation_m", &Vehicle::tyre_relaxation_m, {1e-3, 1.0, false},
           "tyre = brush: rolled length in which the force builds up");
}

void add_start(KeyTable<Vehicle>& t) {
  t.number("start_x_m", &Vehicle::start_x_m, {-1e4, 1e4, false},
           "axle midpoint at t = 0; that of the path if not given (figure eight: 0)");
  t.number("start_y_m", &Vehicle::start_y_m, {-1e4, 1e4, false},
           "axle midpoint at t = 0; that of the path if not given (figure eight: 0)");
  t.number("start_yaw_rad", &Vehicle::start_yaw_rad, kOffset,
           "heading at t = 0; that of the path if not given (figure eight: 0)");
  t.number(
      "start_error_m", &Vehicle::start_error_m, {0.0, 100.0, false},
      "standard deviation of the true start from the assumed one in x and y, clipped at 3 sigma");
  t.number("start_error_rad", &Vehicle::start_error_rad, {0.0, 10.0, false},
           "standard deviation of the true heading at the start, clipped at 3 sigma");
}

void add_errors(KeyTable<Vehicle>& t) {
  constexpr Range kShare{-0.5, 0.5, false};
  t.number("payload_kg", &Vehicle::payload_kg, {0.0, 1e5, false}, "mass of a point payload");
  t.number("payload_x_m", &Vehicle::payload_x_m, kOffset,
           "payload along x, relative to the chassis centre");
  t.number("payload_y_m", &Vehicle::payload_y_m, kOffset,
           "payload along y, relative to the chassis centre");
  t.number("payload_z_m", &Vehicle::payload_z_m, {-1.0, 10.0, false},
           "payload along z, relative to the chassis centre");
  t.number("radius_error", &Vehicle::radius_error, kShare,
           "relative error of the wheel radius: true over assumed, minus 1");
  t.number("track_error", &Vehicle::track_error, kShare,
           "share by which the vehicle believes in too wide a track");
  t.number("left_drag_N", &Vehicle::left_drag_N, kNotNegative,
           "drag of the left wheel, a constant force at its rim against its motion");
  t.number("right_drag_N", &Vehicle::right_drag_N, kNotNegative,
           "drag of the right wheel, a constant force at its rim against its motion");
  t.number("actuator_lag_ms", &Vehicle::actuator_lag_ms, {0.0, 1e4, false},
           "unmodelled time constant of the rim speeds");
  t.number("clock_offset_ms", &Vehicle::clock_offset_ms, {-900.0, 900.0, false},
           "lead of the vehicle's clock over the controller's");
}

bool is_one_of(std::string_view key, std::initializer_list<std::string_view> keys) {
  return std::find(keys.begin(), keys.end(), key) != keys.end();
}

/// Masses and friction have no effect with the kinematic plant, and the drive's errors none with
/// drives on CAN.
std::string why_no_effect(const Scenario& scenario, const std::string& key) {
  const auto& vehicle = scenario.get<Vehicle>();
  if (vehicle.drivetrain == Vehicle::Drivetrain::can &&
      is_one_of(key, {"vehicle.radius_error", "vehicle.track_error", "vehicle.actuator_lag_ms",
                      "vehicle.clock_offset_ms"})) {
    return "vehicle.drivetrain is \"can\"";
  }
  if (vehicle.plant == Vehicle::Plant::kinematic && is_one_of(key, {"world.friction",
                                                                    "world.gravity_mps2",
                                                                    "vehicle.chassis_height_m",
                                                                    "vehicle.chassis_mass_kg",
                                                                    "vehicle.wheel_mass_kg",
                                                                    "vehicle.caster_x_m",
                                                                    "vehicle.caster_radius_m",
                                                                    "vehicle.caster_mass_kg",
                                                                    "vehicle.payload_kg",
                                                                    "vehicle.payload_x_m",
                                                                    "vehicle.payload_y_m",
                                                                    "vehicle.payload_z_m",
                                                                    "vehicle.chassis_z_m",
                                                                    "vehicle.max_wheel_torque_Nm",
                                                                    "vehicle.anti_windup",
                                                                    "vehicle.tyre",
                                                                    "vehicle.tyre_stiffness",
                                                                    "vehicle.tyre_relaxation_m",
                                                                    "vehicle.left_drag_N",
                                                                    "vehicle.right_drag_N",
                                                                    "world.slope_x",
                                                                    "world.slope_y",
                                                                    "world.bump_spacing_m",
                                                                    "world.bump_height_m",
                                                                    "world.bump_length_m"})) {
    return "vehicle.plant is \"kinematic\"";
  }
  if (vehicle.tyre == Vehicle::Tyre::rigid &&
      is_one_of(key, {"vehicle.tyre_stiffness", "vehicle.tyre_relaxation_m"})) {
    return "vehicle.tyre is \"rigid\"";
  }
  return "";
}

/// A step must fit into the batches in which the world moves, and not be longer than the time
/// between two messages about it.
void check_step(const Scenario& scenario, const std::string& file) {
  const Duration step = step_of(scenario.get<World>());
  const double step_ms = scenario.get<World>().step_ms;
  constexpr Duration kBatch = std::chrono::milliseconds{10};
  constexpr Duration kMicrosecond = std::chrono::microseconds{1};
  if (step % kMicrosecond != Duration{0} || kBatch % step != Duration{0}) {
    throw UsageError(
        fmt::format("{}: world.step_ms = {}: the step must be whole microseconds and divide 10 ms: "
                    "0.1, 0.125, 0.2, 0.25, 0.5, 1, 2, 2.5, 5 or 10",
                    file, step_ms));
  }
  if (step > from_seconds(1.0 / scenario.get<RunSettings>().truth_rate_hz)) {
    throw UsageError(
        fmt::format("{}: run.truth_rate_hz = {} asks for more than one state a step: "
                    "world.step_ms = {}",
                    file, scenario.get<RunSettings>().truth_rate_hz, step_ms));
  }
  const auto& vehicle = scenario.get<Vehicle>();
  if (vehicle.drivetrain == Vehicle::Drivetrain::can && step_ms > vehicle.coupling_ms) {
    throw UsageError(
        fmt::format("{}: can.coupling_ms = {} is shorter than a step: "
                    "world.step_ms = {}",
                    file, vehicle.coupling_ms, step_ms));
  }
}

void check(const Scenario& scenario, const std::string& file) {
  check_step(scenario, file);
  const auto& vehicle = scenario.get<Vehicle>();
  const double half_extent_m = scenario.get<World>().half_extent_m;
  for (const char* taken : {"CTRL", "NET", "SIM", "CAN"}) {
    if (!vehicle.name.starts_with(taken)) continue;
    throw UsageError(
        fmt::format("{}: vehicle.name = \"{}\" is not allowed: channels {}... have another meaning",
                    file, vehicle.name, taken));
  }
  if (vehicle.name.starts_with("AGV-")) {
    throw UsageError(fmt::format(
        "{}: vehicle.name = \"{}\" is not allowed: its channels CTRL{}/... would be those of a "
        "vehicle \"{}\"",
        file, vehicle.name, vehicle.name.substr(3), vehicle.name.substr(4)));
  }
  const double inside =
      half_extent_m - std::hypot(vehicle.chassis_length_m, vehicle.chassis_width_m);
  if (inside < 0.0) {
    throw UsageError(
        fmt::format("{}: the vehicle does not fit between walls at ±{} m", file, half_extent_m));
  }
  if (std::abs(vehicle.start_x_m) > inside || std::abs(vehicle.start_y_m) > inside) {
    throw UsageError(fmt::format(
        "{}: the vehicle starts at ({}, {}) m, in or beyond the walls: vehicle.start_x_m and "
        "start_y_m must be within ±{:.2f} m for world.half_extent_m = {}",
        file, vehicle.start_x_m, vehicle.start_y_m, inside, half_extent_m));
  }
  const double farthest_m = std::max(std::abs(vehicle.start_x_m), std::abs(vehicle.start_y_m));
  if (farthest_m + kStartErrorSigmas * vehicle.start_error_m > inside) {
    throw UsageError(
        fmt::format("{}: the vehicle may start in or beyond the walls: its start_x_m = {} and "
                    "start_y_m = {} are off by up to {} times vehicle.start_error_m = {}, and must "
                    "stay within ±{:.2f} m for world.half_extent_m = {}",
                    file, vehicle.start_x_m, vehicle.start_y_m, kStartErrorSigmas,
                    vehicle.start_error_m, inside, half_extent_m));
  }
}

}  // namespace

ScenarioSection world_section() {
  KeyTable<World> t("world.");
  t.number("half_extent_m", &World::half_extent_m, {3.0, 1e4, false},
           "walls stand at x and y = ±this");
  t.number("friction", &World::friction, kFriction,
           "Coulomb friction coefficient of tyres on the floor");
  t.number("wall_friction", &World::wall_friction, kFriction,
           "Coulomb friction coefficient of the body on walls");
  t.number("gravity_mps2", &World::gravity_mps2, {0.1, 100.0, false}, "gravity");
  t.number("step_ms", &World::step_ms, {0.05, 10.0, false}, "physics time step; must divide 10 ms");
  constexpr Range kSlope{-0.5, 0.5, false};
  t.number("slope_x", &World::slope_x, kSlope, "slope of the floor along x, m/m");
  t.number("slope_y", &World::slope_y, kSlope, "slope of the floor along y, m/m");
  t.number("bump_spacing_m", &World::bump_spacing_m, kNotNegative,
           "mean distance between bumps along each wheel's track, at random places; 0 = no bumps");
  t.number("bump_height_m", &World::bump_height_m, {0.0, 1.0, false},
           "height of a bump, which is half a sine wave");
  t.number("bump_length_m", &World::bump_length_m, kLength,
           "length of a bump along the wheel's track");
  ScenarioSection section{.defaults = World{}, .keys = t.take()};
  for (const char* of_bumps : {"world.bump_height_m", "world.bump_length_m"}) {
    section.switched.push_back({of_bumps, {"world.bump_spacing_m"}});
  }
  return section;
}

ScenarioSection vehicle_section() {
  KeyTable<Vehicle> t("vehicle.");
  t.choice<Vehicle::Plant>("plant", &Vehicle::plant,
                           {{"ode", Vehicle::Plant::ode}, {"kinematic", Vehicle::Plant::kinematic}},
                           "physics of the vehicle: rigid bodies, or rolling without slip (fast)");
  t.choice<Vehicle::Drivetrain>(
      "drivetrain", &Vehicle::drivetrain,
      {{"direct", Vehicle::Drivetrain::direct}, {"can", Vehicle::Drivetrain::can}},
      "converts commands to wheel speeds: the simulator, or drives on CAN");
  t.identifier("name", &Vehicle::name, "first part of its LCM channels");
  add_body(t);
  add_tyres(t);
  add_start(t);
  add_errors(t);
  ScenarioSection section{.defaults = Vehicle{}, .keys = t.take()};
  section.why_no_effect = why_no_effect;
  for (const char* of_load :
       {"vehicle.payload_x_m", "vehicle.payload_y_m", "vehicle.payload_z_m"}) {
    section.switched.push_back({of_load, {"vehicle.payload_kg"}});
  }
  section.check = check;
  return section;
}

Instant earliest_stamp(const Sections<RunSettings, VehicleSettings>& settings) {
  return kStart - from_seconds(settings.get<RunSettings>().lead_s +
                               std::abs(settings.get<Vehicle>().clock_offset_ms) * 1e-3);
}

}  // namespace tether
