#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <tether/drive_fault_t.hpp>
#include <tether/drive_request_t.hpp>
#include <vector>

#include "can_bridge/commission/record.hpp"
#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/program/cli.hpp"
#include "tools/can/commission.hpp"
#include "tools/can/drive.hpp"
#include "tools/can/drive_import.hpp"
#include "tools/can/eds.hpp"
#include "tools/can/operator.hpp"
#include "tools/can/probe.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"

namespace tether {
namespace {

struct CanCommandOptions {
  CanOperatorOptions op{kDefaultLcmUrl, "AGV"};
  std::int32_t node = 0;
  std::string kind;
  double value = 0.0;
  CanDriveOptions drive;
  CanProbeOptions probe;
  CanCommissionOptions commission;
  std::string eds_file;
  std::vector<std::int64_t> import_nodes;
};
using SharedOptions = std::shared_ptr<CanCommandOptions>;

CLI::App* add_operator_command(CLI::App& can, const SharedOptions& options, const char* name,
                               const char* what) {
  CLI::App* const command = can.add_subcommand(name, what);
  command->add_option("--lcm-url", options->op.lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_option("--vehicle", options->op.vehicle, "name of the vehicle in the channels")
      ->capture_default_str();
  return command;
}

void add_request(CLI::App& can, const SharedOptions& options, Action& action, const char* name,
                 std::int32_t request, const char* what) {
  add_operator_command(can, options, name, what)->callback([options, request, &action] {
    action = [options, request] { return can_request(options->op, request); };
  });
}

const std::map<std::string, std::int32_t>& fault_kinds() {
  static const std::map<std::string, std::int32_t> kKinds{
      {"none", drive_fault_t::NONE},
      {"fault", drive_fault_t::FAULT},
      {"reboot", drive_fault_t::REBOOT},
      {"silence", drive_fault_t::SILENCE},
      {"sdo_abort", drive_fault_t::SDO_ABORT},
      {"encoder_freeze", drive_fault_t::ENCODER_FREEZE},
      {"wheel_slip", drive_fault_t::WHEEL_SLIP},
      {"push", drive_fault_t::PUSH},
      {"weak_brake", drive_fault_t::WEAK_BRAKE},
      {"safety_input", drive_fault_t::SAFETY_INPUT}};
  return kKinds;
}

void add_inject(CLI::App& can, const SharedOptions& options, Action& action) {
  CLI::App* const command =
      add_operator_command(can, options, "inject", "Inject a fault into the emulated drives");
  std::vector<std::string> names;
  for (const auto& [name, kind] : fault_kinds()) names.push_back(name);
  command
      ->add_option("kind", options->kind, "the fault; none ends all but \"fault\" and \"reboot\"")
      ->required()
      ->check(CLI::IsMember(names));
  command
      ->add_option("--node", options->node,
                   "CANopen node id, or number of the safety input; 0: all")
      ->check(CLI::Range(0, 127))
      ->capture_default_str();
  command
      ->add_option("--value", options->value,
                   "fault: error code; silence: seconds, 0 for good; sdo_abort: object index, 0 "
                   "for all; wheel_slip: share, above 0, up to 1; safety_input: 0 demands, 1 is "
                   "silent, 2 is malformed; push: acceleration of wheels without power, rad/s^2; "
                   "weak_brake: share of the brake ramps that acts, 0 to 1")
      ->check(number_between(-1e9, 1e9))
      ->capture_default_str();
  command->callback([options, &action] {
    action = [options] {
      if (options->kind == "wheel_slip" && !(options->value > 0.0 && options->value <= 1.0)) {
        throw UsageError(
            "wheel_slip needs --value, the share of the motion that is lost: above 0, up to 1");
      }
      return can_inject(options->op, options->node, fault_kinds().at(options->kind),
                        options->value);
    };
  });
}

void add_drive(CLI::App& can, const SharedOptions& options, Action& action) {
  CLI::App* const command =
      add_operator_command(can, options, "drive",
                           "Command one twist for a time, once the vehicle is "
                           "armed; for tests of a vehicle. Ctrl-C stops");
  command->add_option("--v-mps", options->drive.twist.v_mps, "forward speed")
      ->check(number_between(-20.0, 20.0))
      ->capture_default_str();
  command->add_option("--omega-radps", options->drive.twist.omega_radps, "yaw rate, left positive")
      ->check(number_between(-10.0, 10.0))
      ->capture_default_str();
  command->add_option("--for-s", options->drive.for_s, "duration, s")
      ->check(number_between(0.1, 3600.0))
      ->capture_default_str();
  command->callback([options, &action] {
    action = [options] { return can_drive(options->op, options->drive); };
  });
}

void add_probe(CLI::App& can, const SharedOptions& options, Action& action) {
  CLI::App* const command =
      can.add_subcommand("probe",
                         "Identify the drives on a bus, and compare them with a drivetrain file. "
                         "Only reads (SDO uploads); not while the bridge starts up");
  command->add_option("--interface", options->probe.interface, "SocketCAN interface")
      ->capture_default_str();
  CLI::Option* const nodes =
      command->add_option("--node", options->probe.nodes, "CANopen node ids [the file's]")
          ->check(CLI::Range(1, 127));
  CLI::Option* const file =
      command->add_option("--drivetrain", options->probe.drivetrain_file, "compare with this file");
  CLI::Option* const scenario = command->add_option(
      "--scenario", options->probe.scenario_file,
      "the vehicle's scenario: its drivetrain file; ramps must reach its can.max_deceleration_mps2 "
      "[that key's default]");
  command
      ->add_flag("--scan", options->probe.scan,
                 "list all nodes that answer, with device type, vendor and product code")
      ->excludes(nodes)
      ->excludes(file)
      ->excludes(scenario);
  command->callback(
      [options, &action] { action = [options] { return can_probe(options->probe); }; });
}

void add_commission(CLI::App& can, const SharedOptions& options, Action& action) {
  CLI::App* const command = can.add_subcommand(
      "commission",
      "Drive the wheels slowly and measure that each drive stops when the bridge falls silent; "
      "writes the record that arming real drives requires. Stop the bridge first");
  CanCommissionOptions& o = options->commission;
  command->add_option("scenario", o.scenario_file, "scenario file (TOML)")->required();
  command->add_option("--set", o.overrides, "override a scenario key: KEY=VALUE (repeatable)")
      ->allow_extra_args(false);
  command->add_option("--operator", o.operator_name, "name of the person beside the vehicle")
      ->required()
      ->check(CLI::Validator(
          [](std::string& name) { return name.empty() ? "must not be empty" : std::string(); },
          "NAME"));
  CLI::Option* const free =
      command->add_flag("--wheels-free", o.wheels_free, "the wheels turn freely: up to 0.5 m/s");
  CLI::Option* const floor = command->add_flag(
      "--on-the-floor", o.on_floor, "the vehicle drives up to 0.3 m to and fro: up to 0.05 m/s");
  free->excludes(floor);
  command->add_option("--speed-mps", o.speed_mps, "speed of the trials, m/s [the maximum]")
      ->check(number_between(CommissionRecord::kSlowest_mps, 0.5));
  command->add_option("--record", o.record_file,
                      "file to write [can.commission_record, else one in the state folder]");
  command->callback([options, &action] {
    if (!options->commission.wheels_free && !options->commission.on_floor) {
      throw CLI::RequiredError("one of --wheels-free and --on-the-floor");
    }
    action = [options] { return can_commission(options->commission); };
  });
}

int can_import(const CanCommandOptions& options) {
  const std::string& file = options.eds_file;
  const EdsFile eds = read_eds(read_input(file, "the data sheet", kMostTomlBytes), file);
  const DriveSkeleton skeleton = drive_skeleton(eds, file, options.import_nodes);
  fmt::print("{}", skeleton.text);
  for (const std::string& what : skeleton.missing) fmt::print(stderr, "missing: {}\n", what);
  return kExitOk;
}

void add_import(CLI::App& can, const SharedOptions& options, Action& action) {
  CLI::App* const command =
      can.add_subcommand("import",
                         "Print a drivetrain file (profile cia402) from a drive's EDS or DCF, and "
                         "list the values that it does not contain");
  command->add_option("file", options->eds_file, "EDS or DCF file, as CiA 306 describes it")
      ->required();
  command
      ->add_option("--node", options->import_nodes,
                   "CANopen node ids, left and right; one for a device with two axes [a DCF's own "
                   "and the next; else 1 and 2]")
      ->check(CLI::Range(1, 126))
      ->expected(1, 2);
  command->callback([options, &action] { action = [options] { return can_import(*options); }; });
}

}  // namespace

void add_can_command(CLI::App& tether, Action& action) {
  const auto options = std::make_shared<CanCommandOptions>();
  CLI::App* const can = tether.add_subcommand("can", "The CAN drivetrain: arm, stop, look, test")
                            ->require_subcommand(1);
  add_request(*can, options, action, "arm", drive_request_t::ARM,
              "Switch the drives on; the newest command must be fresh and zero");
  add_request(*can, options, action, "disarm", drive_request_t::DISARM,
              "Ramp to zero, then switch the drives off");
  add_request(*can, options, action, "estop", drive_request_t::ESTOP, "Quick stop, and latch");
  add_request(*can, options, action, "release", drive_request_t::ESTOP_RELEASE,
              "Release the e-stop; moves nothing, a reset has to follow");
  add_request(*can, options, action, "reset", drive_request_t::RESET,
              "Clear latched faults; does not arm");
  add_operator_command(*can, options, "hold",
                       "Hold to run: the vehicle stops when this ends (can.operator_timeout_ms)")
      ->callback([options, &action] { action = [options] { return can_hold(options->op); }; });
  add_drive(*can, options, action);
  add_inject(*can, options, action);
  add_operator_command(*can, options, "status", "Print state, wheels and odometry once")
      ->callback([options, &action] { action = [options] { return can_status(options->op); }; });
  add_probe(*can, options, action);
  add_import(*can, options, action);
  add_commission(*can, options, action);
  can->footer(
      "`tether can SCENARIO` is the drivetrain of a run in simulated time: tether-can --help");
}

}  // namespace tether
