#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "common/lcm/lcm_url.hpp"
#include "common/program/cli.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"
#include "tools/doctor/findings.hpp"

namespace tether {
namespace {

struct DoctorOptions {
  std::string lcm_url = kDefaultLcmUrl;
  std::string can;
  bool link = false;
  bool realtime = false;
  double seconds = 10.0;
  double cycle_ms = 20.0;
};

int doctor(const DoctorOptions& options) {
  const Machine machine = examine(options.lcm_url, options.can, options.link);
  auto findings = findings_of(machine);
  if (options.realtime) {
    Latency latency = measure_latency(from_seconds(options.seconds));
    latency.realtime_kernel = machine.realtime_kernel;
    findings.push_back(finding_of(latency, options.cycle_ms));
  }
  fmt::print("{}", text_of(findings));
  return is_anything_wrong(findings) ? kExitFailed : kExitOk;
}

}  // namespace

void add_doctor_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<DoctorOptions>();
  CLI::App* const command = tether.add_subcommand(
      "doctor", "Check this machine: network, buffers, clock, CAN, rights; print remedies");
  command->add_option("--lcm-url", options->lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_option("--can", options->can, "a CAN interface that must be up, such as can0");
  command->add_flag("--link", options->link,
                    "tether-link must run, its peers must be up, and their clocks agree");
  CLI::Option* const realtime =
      command->add_flag("--realtime", options->realtime,
                        "also measure the wake-up latency of the control loop while all processors "
                        "and the disk are busy; not while a vehicle drives");
  command->add_option("--seconds", options->seconds, "duration of the measurement, s")
      ->check(number_between(1.0, 3600.0))
      ->needs(realtime)
      ->capture_default_str();
  command->add_option("--cycle-ms", options->cycle_ms, "cycle of the bridge, can.cycle_ms")
      ->check(number_between(1.0, 1000.0))
      ->needs(realtime)
      ->capture_default_str();
  command->footer("Exit code: 1 if anything is wrong.");
  command->callback([options, &action] { action = [options] { return doctor(*options); }; });
}

}  // namespace tether
