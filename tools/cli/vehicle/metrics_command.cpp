#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <mutex>
#include <string>

#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/service_manager.hpp"
#include "tools/cli/vehicle/vehicle_commands.hpp"
#include "tools/metrics/network_metrics.hpp"
#include "tools/view/server/access.hpp"
#include "tools/view/server/view_server.hpp"

namespace tether {
namespace {

struct MetricsOptions {
  std::string lcm_url = kDefaultLcmUrl;
  std::string address = "127.0.0.1";
  std::uint16_t port = 9765;
  std::string token;
};

constexpr char kPath[] = "/metrics";

int serve_metrics(const MetricsOptions& options) {
  if (!options.token.empty()) check_token(options.token);
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  const std::unique_ptr<Bus> bus = open_bus(options.lcm_url, loop);
  std::mutex mutex;  // the server answers in a thread of its own
  NetworkMetrics metrics;
  CounterList network;
  bus->subscribe(".*", kDeepQueue, [&](const Message& m) {
    const std::scoped_lock lock(mutex);
    metrics.on_message(loop.now(), m.channel, m.bytes);
  });
  loop.every(loop.now(), std::chrono::seconds{1}, Priority::observer, [&](Instant) {
    const std::scoped_lock lock(mutex);
    network.clear();
    bus->list_counters(network);
  });
  ViewServer::Options how;
  how.address = options.address;
  how.port = options.port;
  how.token = options.token;
  how.site = [&](bool is_post, std::string_view path) -> WebAnswer {
    if (is_post) return {.status = 405, .body = "GET and HEAD are allowed\n"};
    if (path != kPath) return {.status = 404, .body = fmt::format("see {}\n", kPath)};
    const std::scoped_lock lock(mutex);
    return {.body = metrics.text(loop.now(), network), .type = NetworkMetrics::kMediaType};
  };
  const ViewServer server(how);
  std::string address = server.address();
  address.insert(std::min(address.find('?'), address.size()), kPath + 1);
  fmt::print("{}\n", address);
  std::fflush(stdout);
  ServiceManager manager(loop);
  manager.ready("serving " + address.substr(0, address.find('?')));
  loop.run();
  manager.stopping();
  return kExitOk;
}

}  // namespace

void add_metrics_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<MetricsOptions>();
  CLI::App* const command = tether.add_subcommand(
      "metrics", "Serve metrics of link, drives and nodes to Prometheus: GET /metrics");
  command
      ->add_option("--address", options->address,
                   "IP address to listen on; addresses other than this host's own (127.0.0.1, ::1) "
                   "require --token")
      ->capture_default_str();
  command->add_option("--port", options->port, "port to listen on; 0: any free port")
      ->check(CLI::Range(0, 65535))
      ->capture_default_str();
  command->add_option("--token", options->token,
                      "access token, 16 characters or more, as /metrics?token=TOKEN [none]");
  command->add_option("--lcm-url", options->lcm_url, "LCM network")
      ->envname("LCM_DEFAULT_URL")
      ->capture_default_str();
  command->callback([options, &action] { action = [options] { return serve_metrics(*options); }; });
}

}  // namespace tether
