#include "common/scenario_keys.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <regex>
#include <type_traits>
#include <utility>

namespace tether {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Allowed finite numbers: [low, high], without low itself if `open`.
struct Range {
  double low = -kInfinity;
  double high = kInfinity;
  bool open = false;

  bool contains(double x) const {
    return std::isfinite(x) && (open ? x > low : x >= low) && x <= high;
  }
  std::string text(const char* noun) const {
    if (std::isinf(low)) return fmt::format("a finite {}", noun);
    if (std::isinf(high)) return fmt::format("a finite {} {} {}", noun, open ? ">" : ">=", low);
    return fmt::format("a {} in {}{}, {}]", noun, open ? "(" : "[", low, high);
  }
};

// Physical ranges, wide but such that nothing overflows within them.
constexpr Range kRatio{0.0, 1.0, false};
constexpr Range kRate{1e-3, 1000.0, false};  // Hz: the physics step is 1 ms
constexpr Range kSojourn{1e-3, 1e9, false};
constexpr Range kLength{1e-3, 100.0, false};
constexpr Range kMass{1e-3, 1e5, false};
constexpr Range kOffset{-100.0, 100.0, false};
constexpr Range kNotNegative{0.0, 1e6, false};
constexpr Range kPositive{1e-3, 1e6, false};
constexpr Range kFriction{0.0, 100.0, false};

template <class Enum>
using Names = std::vector<std::pair<std::string, Enum>>;

std::optional<double> as_double(const ScenarioValue& value) {
  if (const auto* d = std::get_if<double>(&value)) return *d;
  if (const auto* i = std::get_if<std::int64_t>(&value)) return static_cast<double>(*i);
  return std::nullopt;
}

/// Collects keys; `field` is a function from (const) Scenario& to the (const) member's reference.
class KeyTable {
 public:
  template <class Field>
  void number(const std::string& name, Field field, Range range, const std::string& meaning) {
    add(
        name, range.text("number"), meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        number_setter(field, range));
  }

  template <class Field>
  void optional_number(const std::string& name, Field field, Range range,
                       const std::string& meaning) {
    add(
        name, range.text("number"), meaning,
        [field](const Scenario& s) {
          const std::optional<double>& x = field(s);
          return x ? std::optional<ScenarioValue>(*x) : std::nullopt;
        },
        number_setter(field, range));
  }

  template <class Field>
  void whole_number(const std::string& name, Field field, std::int64_t low,
                    const std::string& meaning) {
    const Range range{static_cast<double>(low), kInfinity, false};
    add(
        name, range.text("whole number"), meaning,
        [field](const Scenario& s) {
          return std::optional<ScenarioValue>(static_cast<std::int64_t>(field(s)));
        },
        [field, low](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<std::int64_t>(&value);
          if (x == nullptr || *x < low) return false;
          field(s) = static_cast<std::remove_reference_t<decltype(field(s))>>(*x);
          return true;
        });
  }

  template <class Field>
  void boolean(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "true or false", meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        [field](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<bool>(&value);
          if (x == nullptr) return false;
          field(s) = *x;
          return true;
        });
  }

  template <class Enum, class Field>
  void choice(const std::string& name, Field field, const Names<Enum>& names,
              const std::string& meaning) {
    std::vector<std::string> quoted;
    for (const auto& [text, unused] : names) quoted.push_back("\"" + text + "\"");
    add(
        name, fmt::format("{}", fmt::join(quoted, " or ")), meaning,
        [field, names](const Scenario& s) {
          for (const auto& [text, value] : names) {
            if (value == field(s)) return std::optional<ScenarioValue>(text);
          }
          return std::optional<ScenarioValue>();
        },
        [field, names](Scenario& s, const ScenarioValue& value) {
          const auto* wanted = std::get_if<std::string>(&value);
          for (const auto& [text, option] : names) {
            if (wanted == nullptr || text != *wanted) continue;
            field(s) = option;
            return true;
          }
          return false;
        });
  }

  template <class Field>
  void identifier(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "letters, digits, '-' and '_', at most 32", meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        [field](Scenario& s, const ScenarioValue& value) {
          static const std::regex kPattern("[A-Za-z0-9_-]{1,32}");
          const auto* x = std::get_if<std::string>(&value);
          if (x == nullptr || !std::regex_match(*x, kPattern)) return false;
          field(s) = *x;
          return true;
        });
  }

  /// Names of files and interfaces; empty: not set.
  template <class Field>
  void text(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "printable text without quotes and backslashes", meaning,
        [field](const Scenario& s) {
          const std::string& x = field(s);
          return x.empty() ? std::nullopt : std::optional<ScenarioValue>(x);
        },
        [field](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<std::string>(&value);
          const auto bad = [](unsigned char c) {
            return c < 0x20 || c == 0x7F || c == '"' || c == '\\';
          };
          if (x == nullptr || x->empty() || std::any_of(x->begin(), x->end(), bad)) return false;
          field(s) = *x;
          return true;
        });
  }

  std::vector<ScenarioKey> take() { return std::move(keys_); }

 private:
  template <class Field>
  static decltype(ScenarioKey::set) number_setter(Field field, Range range) {
    return [field, range](Scenario& s, const ScenarioValue& value) {
      const auto x = as_double(value);
      if (!x || !range.contains(*x)) return false;
      field(s) = *x;
      return true;
    };
  }

  void add(const std::string& name, std::string allowed, const std::string& meaning,
           decltype(ScenarioKey::get) get, decltype(ScenarioKey::set) set) {
    keys_.push_back({name, std::move(allowed), meaning, std::move(get), std::move(set)});
  }

  std::vector<ScenarioKey> keys_;
};

// One line a key: the member, reachable through a const and a mutable scenario alike.
#define TETHER_FIELD(member) ([](auto& s) -> auto& { return s.member; })

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
  t.choice<Plant>("vehicle.plant", TETHER_FIELD(vehicle.plant), {{"ode", Plant::ode}},
                  "physics of the vehicle");
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
           "axle midpoint at t = 0");
  t.number("vehicle.start_y_m", TETHER_FIELD(vehicle.start_y_m), {-1e4, 1e4, false},
           "axle midpoint at t = 0");
  t.number("vehicle.start_yaw_rad", TETHER_FIELD(vehicle.start_yaw_rad), kOffset,
           "heading at t = 0");
}

void add_sensor_and_path(KeyTable& t) {
  t.number("sensor.rate_hz", TETHER_FIELD(sensor.rate_hz), kRate, "poses per second");
  t.number("sensor.position_noise_m", TETHER_FIELD(sensor.position_noise_m), kNotNegative,
           "standard deviation of white noise on x and y");
  t.number("sensor.yaw_noise_rad", TETHER_FIELD(sensor.yaw_noise_rad), kNotNegative,
           "standard deviation of white noise on yaw");
  t.number("sensor.latency_ms", TETHER_FIELD(sensor.latency_ms), {0.0, 1e6, false},
           "from measurement to publication");
  using Kind = Scenario::Path::Kind;
  t.choice<Kind>("path.kind", TETHER_FIELD(path.kind), {{"figure_eight", Kind::figure_eight}},
                 "reference path");
  t.number("path.amplitude_m", TETHER_FIELD(path.figure_eight.amplitude_m), {1e-3, 1e4, false},
           "half length of the figure eight");
  t.number("path.rate_radps", TETHER_FIELD(path.figure_eight.rate_radps), {1e-6, 100.0, false},
           "one eight takes 2*pi/this seconds");
  t.number("path.rotation_rad", TETHER_FIELD(path.figure_eight.rotation_rad), kOffset,
           "of the eight's long axis against +x");
}

void add_controller_and_actuator(KeyTable& t) {
  using Controller = Scenario::Controller;
  t.choice<Controller::Law>("controller.law", TETHER_FIELD(controller.law),
                            {{"pid", Controller::Law::pid}}, "control law");
  t.number("controller.tau_s", TETHER_FIELD(controller.tau_s), kNotNegative, "look-ahead");
  t.choice<Controller::Trigger>(
      "controller.trigger", TETHER_FIELD(controller.trigger),
      {{"event", Controller::Trigger::event}, {"timer", Controller::Trigger::timer}},
      "a command per pose that arrives, or at a rate");
  t.number("controller.rate_hz", TETHER_FIELD(controller.rate_hz), kRate,
           "trigger = timer: commands per second");
  t.number("controller.pose_timeout_s", TETHER_FIELD(controller.pose_timeout_s), kNotNegative,
           "a pose older than this stops the vehicle; 0 = never");
  t.number("controller.derivative_filter_s", TETHER_FIELD(controller.derivative_filter_s),
           kNotNegative, "time constant of the low-pass before the D terms");
#define TETHER_GAINS(axis, unit)                                                               \
  t.number("controller." #axis ".p", TETHER_FIELD(controller.axis.p), kNotNegative, "P gain"); \
  t.number("controller." #axis ".i", TETHER_FIELD(controller.axis.i), kNotNegative, "I gain"); \
  t.number("controller." #axis ".d", TETHER_FIELD(controller.axis.d), kNotNegative, "D gain"); \
  t.number("controller." #axis ".limit", TETHER_FIELD(controller.axis.limit), kPositive,       \
           "saturation of the output, ± " unit)
  TETHER_GAINS(v, "m/s");
  TETHER_GAINS(omega, "rad/s");
#undef TETHER_GAINS
  using Policy = Scenario::Actuator::Policy;
  t.choice<Policy>("actuator.policy", TETHER_FIELD(actuator.policy),
                   {{"hold", Policy::hold}, {"zero", Policy::zero}},
                   "hold the last command, or stop after a timeout");
  t.number("actuator.timeout_s", TETHER_FIELD(actuator.timeout_s), kPositive,
           "policy = zero: stop when no new command came for this long");
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

template <class Select>
void add_link(KeyTable& t, const std::string& prefix, Select link) {
#define TETHER_LINK(member) ([link](auto& s) -> auto& { return link(s).member; })
  using Model = LinkConfig::Model;
  t.choice<Model>(prefix + "model", TETHER_LINK(model),
                  {{"fixed", Model::fixed}, {"markov", Model::markov}}, "state process");
  t.number(prefix + "prr", TETHER_LINK(fixed.prr), kRatio, "model = fixed: packet reception ratio");
  t.number(prefix + "delay_ms", TETHER_LINK(fixed.delay_ms), {0.0, 1e6, false},
           "model = fixed: delay");
  t.whole_number(prefix + "queue_limit", TETHER_LINK(queue_limit), 1,
                 "packets under way; more are dropped and counted");
  t.number(prefix + "markov.good.prr", TETHER_LINK(good.prr), kRatio, "in the good state");
  t.number(prefix + "markov.good.delay_ms", TETHER_LINK(good.delay_ms), {0.0, 1e6, false},
           "in the good state");
  t.number(prefix + "markov.bad.prr", TETHER_LINK(bad.prr), kRatio, "in the bad state");
  t.number(prefix + "markov.bad.delay_ms", TETHER_LINK(bad.delay_ms), {0.0, 1e6, false},
           "in the bad state");
  t.number(prefix + "markov.mean_good_s", TETHER_LINK(mean_good_s), kSojourn,
           "mean sojourn time in the good state");
  t.number(prefix + "markov.mean_bad_s", TETHER_LINK(mean_bad_s), kSojourn,
           "mean sojourn time in the bad state");
  t.optional_number(prefix + "markov.p_bad", TETHER_LINK(p_bad), {1e-6, 1.0 - 1e-6, false},
                    "instead of the sojourn times: stationary probability of the bad state ...");
  t.optional_number(prefix + "markov.mean_cycle_s", TETHER_LINK(mean_cycle_s), kSojourn,
                    "... and mean time from one bad spell to the next");
#undef TETHER_LINK
}

}  // namespace

const std::vector<ScenarioKey>& scenario_keys() {
  static const std::vector<ScenarioKey> keys = [] {
    KeyTable t;
    add_run_and_world(t);
    add_vehicle(t);
    add_sensor_and_path(t);
    add_controller_and_actuator(t);
    add_can(t);
    t.boolean("channel.shared_state", TETHER_FIELD(channel.shared_state),
              "both directions follow the uplink's state process");
    add_link(t, "channel.uplink.", TETHER_FIELD(channel.uplink));
    add_link(t, "channel.downlink.", TETHER_FIELD(channel.downlink));
    return t.take();
  }();
  return keys;
}

}  // namespace tether
