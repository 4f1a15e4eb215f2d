#include "can_bridge/drivetrain/can_settings.hpp"

#include <fmt/format.h>

#include <cmath>

#include "common/base/errors.hpp"
#include "common/scenario/key_table.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

using Can = CanSettings;

constexpr double kMostBlind = 10.0;  ///< s and m, with real drives

bool has_can(const Scenario& scenario) {
  return scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can;
}

void add_bus(KeyTable<Can>& t) {
  t.file("drivetrain", &Can::drivetrain_file,
         "file that describes the drives on the bus (drivetrains/), relative to the scenario file");
  t.text("interface", &Can::interface, "live: SocketCAN interface");
  t.number("bit_rate_bps", &Can::bit_rate_bps, {10e3, 1e6, false},
           "bit rate of the simulated bus, and for the bus load");
  t.boolean("emulate_drives", &Can::emulate_drives,
            "live: start tether-can-drive; false where real drives are on the bus");
  t.choice<Can::Wheels>("wheels", &Can::wheels,
                        {{"sim", Can::Wheels::sim}, {"model", Can::Wheels::model}},
                        "wheels that emulated drives turn: the simulator's, or a simple model");
  KeyTable<VehicleSettings> of_vehicle("can.");
  of_vehicle.number("coupling_ms", &VehicleSettings::coupling_ms, {1.0, 50.0, false},
                    "interval between messages of emulated drives and simulated wheels");
  t.append(of_vehicle.take());
  t.choice<Can::Arm>("arm", &Can::arm, {{"once", Can::Arm::once}, {"never", Can::Arm::never}},
                     "the run arms the drivetrain once, or leaves it to an operator");
  t.number("operator_timeout_ms", &Can::operator_timeout_ms, {0.0, 10e3, false},
           "hold-to-run: time without \"tether can hold\" after which the vehicle stops; 0 = off");
  t.text(
      "estop_file", &Can::estop_file,
      "live: file in which the bridge remembers a latched e-stop; empty: with real drives one in "
      "its state folder, else none");
  t.text("commission_record", &Can::commission_record,
         "live: record of \"tether can commission\", which arming compares with the drives; empty: "
         "with real CiA 402 drives one in the state folder, else none");
}

void add_deadlines_and_limits(KeyTable<Can>& t) {
  constexpr Range kDeadline{1.0, 10e3, false};
  t.number("cycle_ms", &Can::cycle_ms, {1.0, 100.0, false}, "control cycle: SYNC and setpoints");
  t.number("stale_ms", &Can::stale_ms, kDeadline,
           "age of the newest command above which the vehicle ramps to zero");
  t.number("disarm_ms", &Can::disarm_ms, kDeadline,
           "age of the newest command above which the bridge makes a quick stop and disarms");
  t.number("max_stale_m", &Can::max_stale_m, kPositive,
           "distance that the vehicle covers during a command's age, above which it ramps to zero");
  t.number(
      "max_blind_s", &Can::max_blind_s, kPositive,
      "maximum time that the vehicle may drive after the pose that the newest plan was made from");
  t.number("max_blind_m", &Can::max_blind_m, kPositive,
           "maximum distance that the vehicle may drive after that pose, by odometry");
  t.number("max_speed_mps", &Can::max_speed_mps, kPositive, "speed limit, forward");
  t.number("max_reverse_mps", &Can::max_reverse_mps, kPositive, "speed limit, backward");
  t.number("max_yaw_rate_radps", &Can::max_yaw_rate_radps, kPositive,
           "yaw rate limit, in both directions");
  t.number("max_acceleration_mps2", &Can::max_acceleration_mps2, kPositive,
           "acceleration limit, away from standstill");
  t.number("max_deceleration_mps2", &Can::max_deceleration_mps2, kPositive,
           "deceleration limit, towards standstill; at least the acceleration");
  t.number("max_yaw_acceleration_radps2", &Can::max_yaw_acceleration_radps2, kPositive,
           "yaw acceleration limit, away from standstill");
  t.number("max_yaw_deceleration_radps2", &Can::max_yaw_deceleration_radps2, kPositive,
           "yaw deceleration limit, towards standstill; at least the acceleration");
  t.number("max_jerk_mps3", &Can::max_jerk_mps3, kPositive, "change of acceleration per second");
  t.number("max_yaw_jerk_radps3", &Can::max_yaw_jerk_radps3, kPositive,
           "change of yaw acceleration per second");
}

void add_injection(KeyTable<Can>& t) {
  t.choice<Can::Inject>("inject", &Can::inject,
                        {{"none", Can::Inject::none},
                         {"fault", Can::Inject::fault},
                         {"reboot", Can::Inject::reboot},
                         {"silence", Can::Inject::silence},
                         {"sdo_abort", Can::Inject::sdo_abort},
                         {"encoder_freeze", Can::Inject::encoder_freeze},
                         {"wheel_slip", Can::Inject::wheel_slip},
                         {"safety_input", Can::Inject::safety_input}},
                        "fault of the emulated drives");
  t.whole_number("inject_node", &Can::inject_node, 0,
                 "node id of the drive, or number of the safety input; 0 = all");
  t.number("inject_at_s", &Can::inject_at_s, {-1e3, 1e6, false},
           "time at which the fault is injected");
  t.number("inject_value", &Can::inject_value, {0.0, 65535.0, false},
           "error code, seconds, object or share: see lcmtypes/tether_drive_fault.lcm");
}

/// Bounds that hold for all real vehicles.
void check_real_drives(const Can& can, const std::string& file) {
  if (can.arm == Can::Arm::once) {
    throw UsageError(fmt::format(
        "{}: can.arm = \"once\" moves the vehicle without an operator: with real "
        "drives (can.emulate_drives = false) it must be \"never\", and an operator arms "
        "(tether can arm)",
        file));
  }
  struct Bound {
    const char* key;
    double value, most;
    const char* why;
  };
  const char* blind = "the limit of driving without a fresh pose";
  for (const Bound& b :
       {Bound{"max_blind_s", can.max_blind_s, kMostBlind, blind},
        {"max_blind_m", can.max_blind_m, kMostBlind, blind},
        {"stale_ms", can.stale_ms, 1000.0, "the age up to which an old command is followed"},
        {"max_stale_m", can.max_stale_m, 2.0, "the distance over which an old command is followed"},
        {"disarm_ms", can.disarm_ms, 5000.0,
         "the age of the last command up to which the vehicle may drive off again"}}) {
    if (b.value <= b.most) continue;
    throw UsageError(
        fmt::format("{}: can.{} = {}: with real drives (can.emulate_drives = false) at most {}: {}",
                    file, b.key, b.value, b.most, b.why));
  }
}

void check_injection(const Can& can, const std::string& file) {
  if (can.inject == Can::Inject::wheel_slip &&
      !(can.inject_value > 0.0 && can.inject_value <= 1.0)) {
    throw UsageError(fmt::format(
        "{}: can.inject = \"wheel_slip\" with can.inject_value = {}: must be the share of the "
        "motion that is lost, above 0, up to 1",
        file, can.inject_value));
  }
  if (can.inject == Can::Inject::safety_input && can.inject_value != 0.0 &&
      can.inject_value != 1.0 && can.inject_value != 2.0) {
    throw UsageError(fmt::format(
        "{}: can.inject = \"safety_input\" with can.inject_value = {}: must be 0 (demands), 1 (is "
        "silent) or 2 (makes no sense)",
        file, can.inject_value));
  }
}

void check(const Scenario& scenario, const std::string& file) {
  if (!has_can(scenario)) return;
  const auto& can = scenario.get<Can>();
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
  // Time that BlindBudget assumes until the brakes act; with less the vehicle never moves.
  const double reaction_s = 0.1 + 4e-3 * can.cycle_ms;
  if (can.max_blind_s <= reaction_s) {
    throw UsageError(fmt::format(
        "{}: can.max_blind_s = {} must be above {}, the time until the brakes act (0.1 s and 4 * "
        "can.cycle_ms)",
        file, can.max_blind_s, reaction_s));
  }
  if (!can.emulate_drives) check_real_drives(can, file);
  check_injection(can, file);
}

}  // namespace

ScenarioSection can_section() {
  KeyTable<Can> t("can.");
  add_bus(t);
  add_deadlines_and_limits(t);
  add_injection(t);
  ScenarioSection section{.defaults = Can{}, .keys = t.take()};
  section.left_out = [](const Scenario& scenario, const ScenarioKey& key) {
    return key.name.starts_with("can.") && !has_can(scenario);
  };
  for (const char* of_fault : {"can.inject_node", "can.inject_at_s", "can.inject_value"}) {
    section.switched.push_back({of_fault, {"can.inject"}, std::string("none")});
  }
  section.check = check;
  return section;
}

std::vector<PathLimit> can_path_limits(const Scenario& scenario) {
  if (!has_can(scenario)) return {};
  const auto& can = scenario.get<Can>();
  return {{"a speed", "m/s", "can.max_speed_mps", can.max_speed_mps,
           [](const PathDemand& d) { return d.point.v_mps; }},
          {"a yaw rate", "rad/s", "can.max_yaw_rate_radps", can.max_yaw_rate_radps,
           [](const PathDemand& d) { return std::abs(d.point.omega_radps); }},
          {"an acceleration", "m/s^2", "can.max_acceleration_mps2", can.max_acceleration_mps2,
           [](const PathDemand& d) { return d.acceleration_mps2; }},
          {"a deceleration", "m/s^2", "can.max_deceleration_mps2", can.max_deceleration_mps2,
           [](const PathDemand& d) { return -d.acceleration_mps2; }},
          {"a yaw acceleration", "rad/s^2", "can.max_yaw_acceleration_radps2",
           can.max_yaw_acceleration_radps2,
           [](const PathDemand& d) { return d.yaw_acceleration_radps2; }},
          {"a yaw deceleration", "rad/s^2", "can.max_yaw_deceleration_radps2",
           can.max_yaw_deceleration_radps2,
           [](const PathDemand& d) { return -d.yaw_acceleration_radps2; }}};
}

}  // namespace tether
