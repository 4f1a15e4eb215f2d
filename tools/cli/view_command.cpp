#include "tools/cli/view_command.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/share.hpp"
#include "common/base/text.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/lcm/udpm_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/program/cli.hpp"
#include "common/program/service_manager.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "netem/channel/settings.hpp"
#include "tools/base/process.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/cli/commands.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/view/server/access.hpp"
#include "tools/view/sources/log_view.hpp"
#include "tools/view/sources/network_view.hpp"
#include "tools/view/sources/report_site.hpp"
#include "tools/view/sources/run_json.hpp"
#include "tools/view/sources/scene_channels.hpp"

namespace tether {
namespace {

void check_origin(const std::string& origin) {
  if (is_origin(origin)) return;
  throw UsageError(fmt::format(
      "--allow-origin \"{}\": has to be what browsers call an origin, scheme://host or "
      "scheme://host:port in lower case and without a path: such as https://app.foxglove.dev",
      printable(origin, kLongestNameShown)));
}

}  // namespace

std::filesystem::path shared_page() { return shared_file("view"); }

std::vector<std::string> ViewOptions::arguments() const {
  std::vector<std::string> all{"--address=" + address, fmt::format("--port={}", port)};
  if (!token.empty()) all.push_back("--token=" + token);
  for (const std::string& origin : origins) all.push_back("--allow-origin=" + origin);
  if (!page.empty()) all.push_back("--page=" + page);
  return all;
}

ViewServer::Options ViewOptions::server(const RunDescription& run) const {
  if (!token.empty()) check_token(token);
  for (const std::string& origin : origins) check_origin(origin);
  ViewServer::Options server;
  server.address = address;
  server.port = port;
  server.token = token;
  server.origins = origins;
  server.page = page.empty() ? shared_page() : std::filesystem::path(page);
  server.title = "tether: " + run.source;
  server.publishable = run.publishable;
  server.has_time = run.kind != "live";
  server.run_json = run_json(run);
  return server;
}

void add_view_options(CLI::App& command, ViewOptions& options, CLI::Option* needs) {
  const std::vector<CLI::Option*> all{
      command
          .add_option("--address", options.address,
                      "IP address that the view listens on; addresses other than this host's own "
                      "(127.0.0.1, ::1) require --token")
          ->capture_default_str(),
      command.add_option("--port", options.port, "port of the view; 0: any free port")
          ->check(CLI::Range(0, 65535))
          ->capture_default_str(),
      command.add_option("--token", options.token, "access token, 16 characters or more [none]"),
      command.add_option("--allow-origin", options.origins,
                         "origin of an external page that may use the view, such as "
                         "https://app.foxglove.dev (repeatable) [none]"),
      command.add_option("--page", options.page,
                         "folder with the page's files [share/tether/view beside bin]")};
  if (needs == nullptr) return;
  for (CLI::Option* const option : all) option->needs(needs);
}

void announce(const ViewServer& server) {
  fmt::print(stderr, "tether: view at {}{}\n", server.address(),
             server.is_everywhere() ? " from here; from elsewhere by an address of this host" : "");
}

namespace {

struct ViewCommandOptions {
  std::string log;
  bool has_url = false;  ///< --lcm-url is on the command line
  std::string lcm_url = kDefaultLcmUrl;
  ScenarioOptions scenario;
  ViewOptions view;
};

int view_log(const ViewCommandOptions& options) {
  ViewedLog log(options.log);
  RunDescription run{.kind = "log", .source = options.log, .notes = log.notes()};
  if (log.scenario()) run.take(*log.scenario());
  run.parameters = playback_descriptions(log.start_s(), log.end_s(), true);
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  ViewServer server(options.view.server(run), scene_channels(run.scene));
  LogView view(loop.now(), log, server);
  loop.add_fd(server.requests_fd(), [&](Instant) {
    for (const ViewRequest& request : server.take_requests()) view.take(loop.now(), request);
  });
  loop.every(loop.now(), LogView::kPeriod, Priority::node,
             [&](Instant) { view.advance(loop.now()); });
  for (const std::string& note : log.notes()) {
    fmt::print(stderr, "tether: {}: {}\n", options.log, note);
  }
  announce(server);
  loop.run();
  return kExitOk;
}

/// The report of a folder of sweeps, and their runs.
int view_report(const ViewCommandOptions& options) {
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());  // from here on signals are for it alone
  ViewServer::Options how = options.view.server({.kind = "report", .source = options.log});
  ReportSite site(options.log, how.page);
  how.site = [&site](bool is_post, std::string_view path) { return site.answer(is_post, path); };
  const ViewServer server(how);
  announce(server);
  loop.run();
  return kExitOk;
}

int view_network(const ViewCommandOptions& options) {
  const std::string url = checked_lcm_url(options.lcm_url);
  std::optional<Scenario> scenario;
  if (!options.scenario.file.empty()) scenario = options.scenario.load();
  RunDescription run{.kind = "live", .source = url, .vehicle = "AGV"};
  NetworkView::Options network;
  if (scenario) {
    run.take(*scenario);
    network.may_drive = scenario->get<ControllerSettings>().is_external();
    network.parameters = NetworkParameters(run.first().get<ChannelSettings>());
  }
  network.vehicles = run.vehicles();
  run.parameters = network.parameters.descriptions();
  run.publishable = NetworkView::publishable(run.vehicles(), network.may_drive);
  RealTimeLoop loop(RealTimeLoop::wall_utime_us());
  const std::unique_ptr<Bus> bus = open_bus(url, loop);
  ViewServer server(options.view.server(run), scene_channels(run.scene));
  NetworkView view(loop, *bus, server, std::move(network));
  loop.add_fd(server.requests_fd(), [&](Instant) {
    for (const ViewRequest& request : server.take_requests()) view.take(request);
  });
  announce(server);
  ServiceManager manager(loop);
  manager.ready("showing " + url);
  loop.run();
  return kExitOk;
}

int view(const ViewCommandOptions& options) {
  if (options.log.empty()) {
    if (!options.scenario.set.empty() && options.scenario.file.empty()) {
      throw UsageError("view: --set changes what is in the file of --scenario, which is missing");
    }
    return view_network(options);
  }
  if (!options.scenario.file.empty() || !options.scenario.set.empty()) {
    throw UsageError(
        "view: the scenario of a log is the scenario.toml beside it, not --scenario or --set");
  }
  if (options.has_url) {
    throw UsageError("view: either a log (or a report's folder), or the network of --lcm-url");
  }
  if (std::filesystem::is_directory(options.log)) return view_report(options);
  if (!std::filesystem::exists(options.log)) {
    check_input(options.log, "the log or the folder of a report", kMostRecordingBytes);
  }
  return view_log(options);
}

}  // namespace

void add_view_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<ViewCommandOptions>();
  CLI::App* const command = tether.add_subcommand(
      "view", "Show a live network, a log or a report in the browser, or in Foxglove");
  command->add_option("log", options->log,
                      "LCM event log to play, or a folder with sweeps and their report.html "
                      "[the network of --lcm-url]");
  CLI::Option* const url = command->add_option("--lcm-url", options->lcm_url, "LCM network")
                               ->envname("LCM_DEFAULT_URL")
                               ->capture_default_str();
  command->add_option("--scenario", options->scenario.file,
                      "scenario that runs on the network, for its walls and path [none]");
  command->add_option("--set", options->scenario.set, "KEY=VALUE of the scenario, as in tether run")
      ->allow_extra_args(false);
  add_view_options(*command, options->view, nullptr);
  command->callback([options, url, &action] {
    const char* const environment = std::getenv("LCM_DEFAULT_URL");
    options->has_url =
        url->count() > 0 && (environment == nullptr || options->lcm_url != environment);
    action = [options] { return view(*options); };
  });
}

}  // namespace tether
