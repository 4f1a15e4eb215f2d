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
};

int doctor(const DoctorOptions& options) {
  const auto findings = findings_of(examine(options.lcm_url, options.can));
  fmt::print("{}", text_of(findings));
  return is_anything_wrong(findings) ? kExitFailed : kExitOk;
}

}  // namespace

void add_doctor_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<DoctorOptions>();
  CLI::App* const command = tether.add_subcommand(
      "doctor", "Check this machine: network, buffers, clock, CAN, rights; and what to do");
  command->add_option("--lcm-url", options->lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_option("--can", options->can, "a CAN interface that must be up, such as can0");
  command->footer("Exit code: 1 if anything is wrong.");
  command->callback([options, &action] { action = [options] { return doctor(*options); }; });
}

}  // namespace tether
