#include "common/scenario/checks.hpp"

#include <fmt/format.h>

#include <cmath>

#include "common/base/errors.hpp"
#include "common/scenario/channel_checks.hpp"

namespace tether {
namespace {

void check_can(const Scenario::Can& can, const std::string& file) {
  if (can.drivetrain_file.empty()) {
    throw UsageError(fmt::format(
        "{}: vehicle.drivetrain = \"can\" needs can.drivetrain, a file of drivetrains/", file));
  }
  if (can.disarm_ms <= can.stale_ms || can.stale_ms < 2.0 * can.cycle_ms) {
    throw UsageError(
        fmt::format("{}: must be 2 * can.cycle_ms <= can.stale_ms < can.disarm_ms; "
                    "they are {}, {} and {} ms",
                    file, can.cycle_ms, can.stale_ms, can.disarm_ms));
  }
  if (can.max_deceleration_mps2 < can.max_acceleration_mps2 ||
      can.max_yaw_deceleration_radps2 < can.max_yaw_acceleration_radps2) {
    throw UsageError(
        fmt::format("{}: stopping must not be weaker than accelerating: can.max_deceleration_mps2 "
                    "= {} and can.max_yaw_deceleration_radps2 = {} must be at least {} and {}",
                    file, can.max_deceleration_mps2, can.max_yaw_deceleration_radps2,
                    can.max_acceleration_mps2, can.max_yaw_acceleration_radps2));
  }
  if (can.inject == Scenario::Can::Inject::wheel_slip &&
      !(can.inject_value > 0.0 && can.inject_value <= 1.0)) {
    throw UsageError(fmt::format(
        "{}: can.inject = \"wheel_slip\" with can.inject_value = {}: must be the share of the "
        "motion that is lost, above 0, up to 1",
        file, can.inject_value));
  }
}

void check_law(const Scenario& scenario, const std::string& file) {
  const Scenario::Controller& controller = scenario.controller;
  if (controller.law == ControlLaw::pid_adaptive && controller.tau_table.empty()) {
    throw UsageError(fmt::format(
        "{}: controller.law = \"pid_adaptive\" needs controller.tau_table, a CSV of look-aheads",
        file));
  }
  if (!sends_plans(controller.law)) return;
  if (scenario.actuator.policy != Scenario::Actuator::Policy::horizon) {
    throw UsageError(
        fmt::format("{}: controller.law is one that sends plans, which the vehicle follows with "
                    "actuator.policy = \"horizon\" only",
                    file));
  }
  if (controller.horizon_s * 1e3 < controller.plan_step_ms) {
    throw UsageError(
        fmt::format("{}: controller.horizon_s = {} is shorter than a step of "
                    "controller.plan_step_ms = {}",
                    file, controller.horizon_s, controller.plan_step_ms));
  }
  constexpr double kMostSteps = 4000.0;  // of a plan_t
  if (controller.horizon_s * 1e3 > controller.plan_step_ms * kMostSteps) {
    throw UsageError(fmt::format(
        "{}: controller.horizon_s = {} has more than {} steps of controller.plan_step_ms = {}",
        file, controller.horizon_s, kMostSteps, controller.plan_step_ms));
  }
}

}  // namespace

void check_combinations(const Scenario& scenario, const std::string& file) {
  check_law(scenario, file);
  if (scenario.vehicle.drivetrain == Scenario::Vehicle::Drivetrain::can)
    check_can(scenario.can, file);
  check_channel(scenario.channel, file);
  const auto& vehicle = scenario.vehicle;
  for (const char* taken : {"CTRL", "NET", "SIM", "CAN"}) {
    if (!vehicle.name.starts_with(taken)) continue;
    throw UsageError(
        fmt::format("{}: vehicle.name = \"{}\" is not allowed: channels {}... have another meaning",
                    file, vehicle.name, taken));
  }
  const double reach = std::hypot(vehicle.chassis_length_m, vehicle.chassis_width_m);
  const double inside = scenario.world.half_extent_m - reach;
  if (inside < 0.0) {
    throw UsageError(fmt::format("{}: the vehicle does not fit between walls at ±{} m", file,
                                 scenario.world.half_extent_m));
  }
  if (std::abs(vehicle.start_x_m) > inside || std::abs(vehicle.start_y_m) > inside) {
    throw UsageError(fmt::format(
        "{}: the vehicle starts at ({}, {}) m, in or beyond the walls: vehicle.start_x_m and "
        "start_y_m must be within ±{:.2f} m for world.half_extent_m = {}",
        file, vehicle.start_x_m, vehicle.start_y_m, inside, scenario.world.half_extent_m));
  }
}

}  // namespace tether
