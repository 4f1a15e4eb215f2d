#include "common/scenario/keys.hpp"

#include "common/scenario/channel_keys.hpp"
#include "common/scenario/key_table.hpp"
#include "common/scenario/path_keys.hpp"

namespace tether {
namespace {

// Physical ranges, wide but such that nothing overflows within them.
constexpr Range kRate{1e-3, 1000.0, false};  // Hz: the physics step is 1 ms
constexpr Range kLength{1e-3, 100.0, false};
constexpr Range kMass{1e-3, 1e5, false};
constexpr Range kOffset{-100.0, 100.0, false};
constexpr Range kNotNegative{0.0, 1e6, false};
constexpr Range kPositive{1e-3, 1e6, false};
constexpr Range kGain{1e-3, 1e3, false};
constexpr Range kFriction{0.0, 100.0, false};

void add_run_and_world(KeyTable& t) {
  t.number("run.duration_s", TETHER_FIELD(run.duration_s), {0.0, 1e6, true}, "length of the run");
  t.number("run.lead_s", TETHER_FIELD(run.lead_s), {0.0, 1e3, false},
           "the loop lives this long before the path starts; the vehicle stands");
  t.whole_number("run.seed", TETHER_FIELD(run.seed), 0, "seed of all random streams");
  t.number("run.truth_rate_hz", TETHER_FIELD(run.truth_rate_hz), kRate,
           "SIM/TRUTH messages and trajectory rows per second");
  t.number("run.report_period_s", TETHER_FIELD(run.report_period_s), {0.01, 1e6, false},
           "between link reports, and between counter reports");
  t.number("world.half_extent_m", TETHER_FIELD(world.half_extent_m), {3.0, 1e4, false},
           "walls stand at x and y = ±this");
  t.number("world.friction", TETHER_FIELD(world.friction), kFriction,
           "Coulomb friction coefficient of tyres on the floor");
  t.number("world.wall_friction", TETHER_FIELD(world.wall_friction), kFriction,
           "Coulomb friction coefficient of the body on walls");
  t.number("world.gravity_mps2", TETHER_FIELD(world.gravity_mps2), {0.1, 100.0, false}, "gravity");
}

void add_vehicle(KeyTable& t) {
  using Plant = Scenario::Vehicle::Plant;
  t.choice<Plant>("vehicle.plant", TETHER_FIELD(vehicle.plant),
                  {{"ode", Plant::ode}, {"kinematic", Plant::kinematic}},
                  "physics of the vehicle: rigid bodies, or rolling without slip (fast)");
  using Drivetrain = Scenario::Vehicle::Drivetrain;
  t.choice<Drivetrain>("vehicle.drivetrain", TETHER_FIELD(vehicle.drivetrain),
                       {{"direct", Drivetrain::direct}, {"can", Drivetrain::can}},
                       "what turns commands into wheel speeds: the simulator, or drives on CAN");
  t.identifier("vehicle.name", TETHER_FIELD(vehicle.name), "first part of its LCM channels");
#define TETHER_SIZE(key, range, meaning) \
  t.number("vehicle." #key, TETHER_FIELD(vehicle.key), range, meaning)
  TETHER_SIZE(chassis_length_m, kLength, "chassis box along x");
  TETHER_SIZE(chassis_width_m, kLength, "chassis box along y");
  TETHER_SIZE(chassis_height_m, kLength, "chassis box along z");
  TETHER_SIZE(chassis_mass_kg, kMass, "chassis box without caster");
  TETHER_SIZE(wheel_radius_m, kLength, "drive wheels");
  TETHER_SIZE(wheel_width_m, kLength, "drive wheels");
  TETHER_SIZE(wheel_mass_kg, kMass, "each drive wheel");
  TETHER_SIZE(track_m, kLength, "between the wheels' centres");
  t.number("vehicle.axle_x_m", TETHER_FIELD(vehicle.axle_x_m), kOffset,
           "drive axle, relative to the chassis centre");
  t.number("vehicle.caster_x_m", TETHER_FIELD(vehicle.caster_x_m), kOffset,
           "caster ball, relative to the chassis centre");
  TETHER_SIZE(caster_radius_m, kLength, "caster ball");
  TETHER_SIZE(caster_mass_kg, kMass, "caster ball");
  TETHER_SIZE(max_wheel_torque_Nm, kPositive, "torque limit of each wheel's speed servo");
  TETHER_SIZE(max_wheel_acceleration_mps2, kPositive, "slew rate of each wheel's rim speed");
  TETHER_SIZE(max_wheel_speed_mps, kPositive, "rim speed limit; both wheels are scaled together");
#undef TETHER_SIZE
  t.number("vehicle.start_x_m", TETHER_FIELD(vehicle.start_x_m), {-1e4, 1e4, false},
           "axle midpoint at t = 0; that of the path if not given (figure eight: 0)");
  t.number("vehicle.start_y_m", TETHER_FIELD(vehicle.start_y_m), {-1e4, 1e4, false},
           "axle midpoint at t = 0; that of the path if not given (figure eight: 0)");
  t.number("vehicle.start_yaw_rad", TETHER_FIELD(vehicle.start_yaw_rad), kOffset,
           "heading at t = 0; that of the path if not given (figure eight: 0)");
}

void add_vehicle_errors(KeyTable& t) {
  constexpr Range kShare{-0.5, 0.5, false};
  t.number("vehicle.payload_kg", TETHER_FIELD(vehicle.payload_kg), {0.0, 1e5, false},
           "a load, a point at the chassis centre's height");
  t.number("vehicle.payload_x_m", TETHER_FIELD(vehicle.payload_x_m), kOffset,
           "of the load, relative to the chassis centre");
  t.number("vehicle.payload_y_m", TETHER_FIELD(vehicle.payload_y_m), kOffset,
           "of the load, relative to the chassis centre");
  t.number("vehicle.radius_error", TETHER_FIELD(vehicle.radius_error), kShare,
           "share by which the wheels are larger than the vehicle believes");
  t.number("vehicle.track_error", TETHER_FIELD(vehicle.track_error), kShare,
           "share by which the vehicle believes in too wide a track");
  t.number("vehicle.actuator_lag_ms", TETHER_FIELD(vehicle.actuator_lag_ms), {0.0, 1e4, false},
           "time constant of the rim speeds, which nobody allows for");
  t.number("vehicle.clock_offset_ms", TETHER_FIELD(vehicle.clock_offset_ms), {-900.0, 900.0, false},
           "the vehicle's clock is ahead of the controller's by this");
}

void add_sensor(KeyTable& t) {
  t.number("sensor.rate_hz", TETHER_FIELD(sensor.rate_hz), kRate, "poses per second");
  t.number("sensor.position_noise_m", TETHER_FIELD(sensor.position_noise_m), kNotNegative,
           "standard deviation of white noise on x and y");
  t.number("sensor.yaw_noise_rad", TETHER_FIELD(sensor.yaw_noise_rad), kNotNegative,
           "standard deviation of white noise on yaw");
  t.number("sensor.position_drift_mpsqrts", TETHER_FIELD(sensor.position_drift_mpsqrts),
           kNotNegative, "random walk on x and y: standard deviation after 1 s");
  t.number("sensor.yaw_drift_radpsqrts", TETHER_FIELD(sensor.yaw_drift_radpsqrts), kNotNegative,
           "random walk on yaw: standard deviation after 1 s");
  t.number("sensor.latency_ms", TETHER_FIELD(sensor.latency_ms), {0.0, 1e6, false},
           "from measurement to publication");
}

void add_planning(KeyTable& t) {
  t.text("controller.tau_table", TETHER_FIELD(controller.tau_table),
         "law = pid_adaptive: CSV of look-aheads by network, relative to the scenario file");
  t.number("controller.horizon_s", TETHER_FIELD(controller.horizon_s), {0.05, 200.0, false},
           "length of a plan");
  t.number("controller.plan_step_ms", TETHER_FIELD(controller.plan_step_ms), {5.0, 1000.0, false},
           "each twist of a plan is in force for this long; a horizon has at most 4000");
  t.boolean("controller.preload", TETHER_FIELD(controller.preload),
            "the first plan is on board before departure");
}

void add_feedback_and_model(KeyTable& t) {
  t.number("controller.tracking.k_x", TETHER_FIELD(controller.tracking.k_x), kGain,
           "along the path, 1/s");
  t.number("controller.tracking.k_y", TETHER_FIELD(controller.tracking.k_y), kGain,
           "across the path, 1/m^2");
  t.number("controller.tracking.k_theta", TETHER_FIELD(controller.tracking.k_theta), kGain,
           "heading, 1/m");
  t.number("controller.tracking.max_lateral_mps2",
           TETHER_FIELD(controller.tracking.max_lateral_mps2), {0.1, 100.0, false},
           "speed times yaw rate while catching up with the path");
  t.optional_number("controller.model.track_m", TETHER_FIELD(controller.model.track_m), kLength,
                    "in predictions; not set: the vehicle's");
  t.optional_number("controller.model.max_wheel_acceleration_mps2",
                    TETHER_FIELD(controller.model.max_wheel_acceleration_mps2), kPositive,
                    "in predictions; not set: the vehicle's");
}

void add_controller(KeyTable& t) {
  using Controller = Scenario::Controller;
#define TETHER_LAW(name, sends) {#name, ControlLaw::name},
  t.choice<ControlLaw>("controller.law", TETHER_FIELD(controller.law),
                       {TETHER_CONTROL_LAWS(TETHER_LAW)}, "control law: docs/controllers.md");
#undef TETHER_LAW
  t.boolean("controller.external", TETHER_FIELD(controller.external),
            "no controller is started: the run waits for one of yours (docs/time.md)");
  t.number("controller.tau_s", TETHER_FIELD(controller.tau_s), kNotNegative, "look-ahead");
  t.choice<Controller::Trigger>(
      "controller.trigger", TETHER_FIELD(controller.trigger),
      {{"event", Controller::Trigger::event}, {"timer", Controller::Trigger::timer}},
      "a command per pose that arrives, or at a rate");
  t.number("controller.rate_hz", TETHER_FIELD(controller.rate_hz), kRate,
           "trigger = timer: commands per second");
  t.number("controller.pose_timeout_s", TETHER_FIELD(controller.pose_timeout_s), kNotNegative,
           "a pose older than this stops the vehicle; 0 = never");
  t.boolean("controller.wrap_heading", TETHER_FIELD(controller.wrap_heading),
            "heading error within (-pi, pi]; false: as it comes, turning the long way round");
  t.number("controller.derivative_filter_s", TETHER_FIELD(controller.derivative_filter_s),
           kNotNegative, "time constant of the low-pass before the D terms");
  add_planning(t);  // before the sections of the gains
#define TETHER_GAINS(axis, unit)                                                               \
  t.number("controller." #axis ".p", TETHER_FIELD(controller.axis.p), kNotNegative, "P gain"); \
  t.number("controller." #axis ".i", TETHER_FIELD(controller.axis.i), kNotNegative, "I gain"); \
  t.number("controller." #axis ".d", TETHER_FIELD(controller.axis.d), kNotNegative, "D gain"); \
  t.number("controller." #axis ".limit", TETHER_FIELD(controller.axis.limit), kPositive,       \
           "saturation of the output, ± " unit)
  TETHER_GAINS(v, "m/s");
  TETHER_GAINS(omega, "rad/s");
#undef TETHER_GAINS
  add_feedback_and_model(t);
}

void add_actuator(KeyTable& t) {
  using Policy = Scenario::Actuator::Policy;
  t.choice<Policy>("actuator.policy", TETHER_FIELD(actuator.policy),
                   {{"hold", Policy::hold},
                    {"zero", Policy::zero},
                    {"ramp", Policy::ramp},
                    {"decay", Policy::decay},
                    {"horizon", Policy::horizon}},
                   "hold the last command, stop in some way after a timeout, or follow plans");
  t.number("actuator.timeout_s", TETHER_FIELD(actuator.timeout_s), kPositive,
           "policy = zero, ramp, decay, horizon: stop when no new twist came for this long");
  t.number("actuator.decay_s", TETHER_FIELD(actuator.decay_s), kPositive,
           "policy = decay: time constant of the stop");
  t.number("actuator.deceleration_mps2", TETHER_FIELD(actuator.deceleration_mps2), kPositive,
           "policy = ramp, horizon: of the stop after the timeout or the horizon");
  t.number("actuator.yaw_deceleration_radps2", TETHER_FIELD(actuator.yaw_deceleration_radps2),
           kPositive, "policy = ramp, horizon: of the stop after the timeout or the horizon");
}

void add_can(KeyTable& t) {
  using Can = Scenario::Can;
  t.text("can.drivetrain", TETHER_FIELD(can.drivetrain_file),
         "what is on the bus: a file of drivetrains/, relative to the scenario file");
  t.text("can.interface", TETHER_FIELD(can.interface), "live: SocketCAN interface");
  t.number("can.bit_rate_bps", TETHER_FIELD(can.bit_rate_bps), {10e3, 1e6, false},
           "of the simulated bus, and for the bus load");
  t.boolean("can.emulate_drives", TETHER_FIELD(can.emulate_drives),
            "live: start tether-can-drive; false where real drives are on the bus");
  t.choice<Can::Wheels>("can.wheels", TETHER_FIELD(can.wheels),
                        {{"sim", Can::Wheels::sim}, {"model", Can::Wheels::model}},
                        "what emulated drives turn: the simulator's wheels or a simple model");
  t.number("can.coupling_ms", TETHER_FIELD(can.coupling_ms), {1.0, 50.0, false},
           "between messages of emulated drives and simulated wheels");
  t.choice<Can::Arm>("can.arm", TETHER_FIELD(can.arm),
                     {{"once", Can::Arm::once}, {"never", Can::Arm::never}},
                     "the run arms the drivetrain once, or leaves it to an operator");
  constexpr Range kDeadline{1.0, 10e3, false};
  t.number("can.cycle_ms", TETHER_FIELD(can.cycle_ms), {1.0, 100.0, false},
           "control cycle: SYNC and setpoints");
  t.number("can.stale_ms", TETHER_FIELD(can.stale_ms), kDeadline,
           "a command older than this: ramp to zero");
  t.number("can.disarm_ms", TETHER_FIELD(can.disarm_ms), kDeadline,
           "a command older than this: quick stop and disarm");
#define TETHER_LIMIT(key, meaning) t.number("can." #key, TETHER_FIELD(can.key), kPositive, meaning)
  TETHER_LIMIT(max_speed_mps, "forward");
  TETHER_LIMIT(max_reverse_mps, "backward");
  TETHER_LIMIT(max_yaw_rate_radps, "either way");
  TETHER_LIMIT(max_acceleration_mps2, "away from standstill");
  TETHER_LIMIT(max_deceleration_mps2, "towards standstill; at least the acceleration");
  TETHER_LIMIT(max_yaw_acceleration_radps2, "away from standstill");
  TETHER_LIMIT(max_yaw_deceleration_radps2, "towards standstill; at least the acceleration");
  TETHER_LIMIT(max_jerk_mps3, "change of acceleration per second");
  TETHER_LIMIT(max_yaw_jerk_radps3, "change of yaw acceleration per second");
#undef TETHER_LIMIT
  t.choice<Can::Inject>("can.inject", TETHER_FIELD(can.inject),
                        {{"none", Can::Inject::none},
                         {"fault", Can::Inject::fault},
                         {"reboot", Can::Inject::reboot},
                         {"silence", Can::Inject::silence},
                         {"sdo_abort", Can::Inject::sdo_abort},
                         {"encoder_freeze", Can::Inject::encoder_freeze},
                         {"wheel_slip", Can::Inject::wheel_slip}},
                        "a fault of the emulated drives");
  t.whole_number("can.inject_node", TETHER_FIELD(can.inject_node), 0,
                 "the drive's node id; 0 = all");
  t.number("can.inject_at_s", TETHER_FIELD(can.inject_at_s), {-1e3, 1e6, false}, "when");
  t.number("can.inject_value", TETHER_FIELD(can.inject_value), {0.0, 65535.0, false},
           "error code, seconds, object or share: see lcmtypes/tether_drive_fault.lcm");
}

}  // namespace

const std::vector<ScenarioKey>& scenario_keys() {
  static const std::vector<ScenarioKey> keys = [] {
    KeyTable t;
    add_run_and_world(t);
    add_vehicle(t);
    add_vehicle_errors(t);
    add_sensor(t);
    add_path_keys(t);
    add_controller(t);
    add_actuator(t);
    add_can(t);
    add_channel_keys(t);
    return t.take();
  }();
  return keys;
}

std::string why_plant_ignores(const Scenario& scenario, const std::string& key) {
  if (scenario.vehicle.drivetrain == Scenario::Vehicle::Drivetrain::can) {
    for (const char* ignored : {"vehicle.radius_error", "vehicle.track_error",
                                "vehicle.actuator_lag_ms", "vehicle.clock_offset_ms"}) {
      if (key == ignored) return "vehicle.drivetrain is \"can\"";
    }
  }
  if (scenario.vehicle.plant != Scenario::Vehicle::Plant::kinematic) return "";
  for (const char* ignored :
       {"world.friction", "world.gravity_mps2", "vehicle.chassis_height_m",
        "vehicle.chassis_mass_kg", "vehicle.wheel_mass_kg", "vehicle.caster_x_m",
        "vehicle.caster_radius_m", "vehicle.caster_mass_kg", "vehicle.payload_kg",
        "vehicle.payload_x_m", "vehicle.payload_y_m", "vehicle.max_wheel_torque_Nm"}) {
    if (key == ignored) return "vehicle.plant is \"kinematic\"";
  }
  return "";
}

std::string why_law_ignores(const Scenario& scenario, const std::string& key) {
  const ControlLaw law = scenario.controller.law;
  const bool is_pid = law == ControlLaw::pid || law == ControlLaw::pid_adaptive;
  const auto one_of = [&key](std::initializer_list<const char*> prefixes) {
    for (const char* prefix : prefixes) {
      if (key.starts_with(prefix)) return true;
    }
    return false;
  };
  const bool ignored =
      (key == "controller.tau_table" && law != ControlLaw::pid_adaptive) ||
      (is_pid && one_of({"controller.tracking."})) ||
      ((is_pid || law == ControlLaw::tracking) && one_of({"controller.model."})) ||
      (!sends_plans(law) &&
       one_of({"controller.horizon_s", "controller.plan_step_ms", "controller.preload"}));
  return ignored ? "controller.law is another one" : "";
}

std::vector<ScenarioKey> named_link_keys(const std::string& name) {
  KeyTable t;
  add_link_keys(t, "channel.links." + name + ".", {LinkSelect::Which::by_name, name});
  return t.take();
}

}  // namespace tether
