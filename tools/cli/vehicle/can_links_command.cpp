#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "can_bridge/bus/link_service.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/service_manager.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"

namespace tether {
namespace {

struct CanLinksOptions {
  std::string socket = kCanLinkService;
  bool lock_memory = false;
};

int serve_can_links(const CanLinksOptions& options) {
  if (options.lock_memory) lock_memory();
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  const CanLinkService service(options.socket, loop);
  ServiceManager manager(loop);
  manager.ready("listening at " + options.socket);
  loop.run();
  manager.stopping();
  return kExitOk;
}

}  // namespace

void add_can_links_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<CanLinksOptions>();
  CLI::App* const command = tether.add_subcommand(
      "can-links", "Take CAN interfaces down and up for a bridge that lacks CAP_NET_ADMIN");
  command->add_option("--socket", options->socket, "Socket where the bridge asks")
      ->capture_default_str();
  command->add_flag("--lock-memory", options->lock_memory, "keep all memory from being paged out");
  command->footer(
      "The bridge restarts its interface after a stall, so that no old setpoint leaves the "
      "adapter. Needs CAP_NET_ADMIN, and a folder that only the bridge's user can enter: "
      "tether-can-links.service has both. Other interfaces than CAN's are refused.");
  command->callback(
      [options, &action] { action = [options] { return serve_can_links(*options); }; });
}

}  // namespace tether
