#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "common/base/errors.hpp"
#include "common/lcm/host_routes.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udp_sockets.hpp"
#include "common/program/cli.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"

namespace tether {
namespace {

struct LcmRouteOptions {
  std::string lcm_url = kDefaultLcmUrl;
  bool remove = false;
};

int lcm_route(const LcmRouteOptions& options) {
  const std::string url = checked_lcm_url(options.lcm_url);
  const std::string group = multicast_group(url);
  if (group.empty()) throw UsageError(fmt::format("lcm-route: {} needs no route", url));
  if (lcm_option(url, "ttl") != 0) {
    throw UsageError(fmt::format(
        "lcm-route: {} spans several hosts; with ttl=0 its group would stay on this one", url));
  }
  const in_addr address = udpm_address(url).sin_addr;
  if (options.remove) {
    remove_loopback_route(address);
  } else {
    route_over_loopback(address);
    fmt::print("{} is reached by {}\n", group, outgoing_interface(address));
  }
  return kExitOk;
}

}  // namespace

void add_lcm_route_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<LcmRouteOptions>();
  CLI::App* const command = tether.add_subcommand(
      "lcm-route", "Keep LCM on this host: route its multicast group over the loopback interface");
  command->add_option("--lcm-url", options->lcm_url, "LCM network, with ttl=0")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->add_flag("--remove", options->remove, "remove that route again");
  command->footer(
      "Without it the group leaves by the default route: LCM programs hear each other no longer "
      "when "
      "that interface goes down. Needs CAP_NET_ADMIN. Lasts until this host restarts: "
      "tether-host.service does it at each start.");
  command->callback([options, &action] { action = [options] { return lcm_route(*options); }; });
}

}  // namespace tether
