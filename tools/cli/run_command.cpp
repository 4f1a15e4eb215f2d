#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/program/cli.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/tube/reach_tube.hpp"
#include "netem/channel/settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "tools/base/scenario_options.hpp"
#include "tools/cli/commands.hpp"
#include "tools/cli/view_command.hpp"
#include "tools/log/scene_setting.hpp"
#include "tools/margin/loop_margins.hpp"
#include "tools/nodes/closed_loop.hpp"
#include "tools/nodes/external_run.hpp"
#include "tools/nodes/process_run.hpp"
#include "tools/runs/channel_report.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"
#include "tools/runs/run_summary.hpp"
#include "tools/view/server/playback.hpp"
#include "tools/view/sources/network_view.hpp"
#include "tools/view/sources/paced_run.hpp"
#include "tools/view/sources/run_json.hpp"
#include "tools/view/sources/scene_channels.hpp"

namespace tether {
namespace {

struct RunOptions {
  ScenarioOptions scenario;
  std::string out;
  bool json = false;
  bool keys = false;
  bool processes = false;
  std::string lcm_url;
  double patience_s = 10.0;
  bool step = false;
  bool view = false;
  double speed = 1.0;
  ViewOptions viewing;
};

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::atomic<int> caught_signal{0};

/// From here on Ctrl-C and SIGTERM are noticed by end_if_told(); a second one ends the program.
void notice_signals() {
  struct sigaction action {};
  action.sa_handler = [](int signal) { caught_signal = signal; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  for (const int signal : {SIGINT, SIGTERM}) sigaction(signal, &action, nullptr);
}

void end_if_told(Instant now) {
  if (caught_signal == 0) return;
  throw std::runtime_error(
      fmt::format("ended by signal {} at t = {:.3f} s", caught_signal.load(), to_seconds(now)));
}

/// Runs to the end; on a terminal, shows how far it is when it takes longer than a second.
void run_with_progress(ClosedLoop& loop, Instant end) {
  const bool show = isatty(STDERR_FILENO) != 0;
  const double start_s = wall_seconds();
  double shown_s = start_s;
  for (Instant t = kStart; t < end; t = std::min(end, t + std::chrono::seconds{1})) {
    loop.run_until(t);
    end_if_told(t);
    const double now_s = wall_seconds();
    if (!show || now_s - shown_s < 1.0) continue;
    shown_s = now_s;
    const double share = to_seconds(t) / to_seconds(end);
    fmt::print(stderr, "\r\033[K{:.0f} of {:.0f} s simulated, about {:.0f} s to go", to_seconds(t),
               to_seconds(end), (now_s - start_s) * (1.0 / share - 1.0));
  }
  loop.run_until(end);
  loop.finish();
  if (shown_s > start_s) fmt::print(stderr, "\r\033[K");
}

/// A run that is looked at while it is computed, at a pace.
class ViewedRun {
 public:
  /// Subscribes to the bus: before the run.
  ViewedRun(const RunOptions& options, const Scenario& scenario, ClosedLoop& loop)
      : loop_(loop),
        speed_(options.speed),
        parameters_(loop.members().front().get<ChannelSettings>()) {
    const double end_s = scenario.get<RunSettings>().duration_s;
    RunDescription run{.kind = "run", .source = options.scenario.file};
    run.take(scenario);
    run.publishable = NetworkView::publishable(run.vehicles(), false);
    run.parameters = parameters_.descriptions();
    for (auto& one : playback_descriptions(to_seconds(loop.loop().now()), end_s, false)) {
      run.parameters.push_back(std::move(one));
    }
    server_.emplace(options.viewing.server(run), scene_channels(run.scene));
    network_.emplace(
        loop.loop(), loop.bus(), *server_,
        NetworkView::Options{
            .vehicles = run.vehicles(), .ask_relay = false, .parameters = parameters_});
  }

  void run(Instant end) {
    PacedRun paced(loop_.loop().now(), end, speed_, *server_, *network_);
    announce(*server_);
    paced.run([this](Instant t) {
      loop_.run_until(t);
      end_if_told(t);
    });
    loop_.finish();
  }

 private:
  ClosedLoop& loop_;
  double speed_;
  NetworkParameters parameters_;
  std::optional<ViewServer> server_;
  std::optional<NetworkView> network_;
};

/// Says what was lost on the run's network.
void tell_of_losses(const TimeManager& manager) {
  const TimeManager::Counters& c = manager.counters();
  if (c.repeated + c.resends == 0) return;
  fmt::print(stderr, "tether: {} grants were repeated, {} messages sent again; {}\n", c.repeated,
             c.resends, advice_on_lost_messages());
}

/// Says what came on the run's network without effect.
void tell_of_others(const TimeManager& manager) {
  const TimeManager::Counters& c = manager.counters();
  if (c.forged > 0) {
    fmt::print(stderr, "tether: {} answers had not their node's key: they had no effect\n",
               c.forged);
  }
  for (const auto& [channel, count] : manager.unaccounted()) {
    fmt::print(stderr, "tether: {} messages on {} are in no node's answer: they had no effect\n",
               count, channel);
  }
}

/// Why a lost vehicle was bound to be lost, where the theory of `tether margin` applies; ""
/// elsewhere.
std::string theory_text(const Scenario& scenario) {
  if (!margin_obstacles(scenario).empty()) return "";
  const LoopMargins margins = loop_margins(scenario);
  if (margins.radius < 1.0) return "";
  if (margins.prr_each_way.kind == Critical::Kind::never) {
    return fmt::format(
        "{:<9} unstable even without loss, at a command period of {:g} s and a delay of {:.3g} ms: "
        "tether margin\n",
        "theory", margins.period_s, margins.delay_s * 1e3);
  }
  return fmt::format("{:<9} unstable with the losses of this channel: tether margin\n", "theory");
}

void report(const RunOptions& options, const Scenario& scenario, const FleetObserver& observer,
            const RunSummary& summary, std::optional<OutputFolder>& folder) {
  const std::string json = to_json(scenario, observer, summary);
  fmt::print("{}", options.json ? json + "\n" : to_text(scenario, observer, summary));
  if (!options.json && observer.is_one() && observer.first().truth().lost) {
    fmt::print("{}", theory_text(scenario));
  }
  if (!folder) return;
  folder->write(scenario, observer, json);  // a full disk ends it here
  if (!options.json) {
    fmt::print("{:<9} {}\n", "picture", (folder->path() / "path.png").string());
  }
}

Scenario checked_scenario(const RunOptions& options) {
  if (options.step && fcntl(STDIN_FILENO, F_GETFD) < 0) {
    throw UsageError("run: --step reads commands from the standard input, which is closed");
  }
  if (options.scenario.file.empty()) throw UsageError("run: name a scenario file (see --help)");
  Scenario scenario = options.scenario.load();
  const bool external = scenario.get<ControllerSettings>().is_external();
  if (scenario.get<ControllerSettings>().ros2 && !options.processes) {
    throw UsageError("run: controller.ros2 = true needs --processes, which starts tether-ros2");
  }
  if (!options.lcm_url.empty() && !options.processes && !external) {
    throw UsageError("run: --lcm-url needs --processes or an external controller");
  }
  if (options.lcm_url.empty()) {
    check_command_has_url(scenario.get<ControllerSettings>(), options.scenario.file);
  }
  if (options.view && external) {
    throw UsageError(
        "run: --view cannot show a run with an external controller; use --out, then tether view "
        "RUN.lcmlog");
  }
  for (const std::string& warning : scenario_warnings(scenario)) {
    fmt::print(stderr, "tether: {}: {}\n", options.scenario.file, warning);
  }
  return scenario;
}

/// How a run is made: all in this process, each node in one of its own, or all but the controller,
/// which is an external program.
struct Way {
  std::optional<ClosedLoop> one;
  std::optional<ProcessRun> many;
  std::optional<ExternalController> controller;
  std::optional<ExternalRun> with_another;

  Way(const RunOptions& options, const Scenario& scenario) {
    if (options.processes) {
      many.emplace(ProcessRun::Options{.scenario_file = options.scenario.file,
                                       .overrides = options.scenario.overrides(),
                                       .lcm_url = options.lcm_url,
                                       .patience_s = options.patience_s,
                                       .step = options.step},
                   scenario);
    } else if (scenario.get<ControllerSettings>().is_external()) {
      controller.emplace(options.lcm_url, tell_of_controller);
      with_another.emplace(scenario, *controller);
    } else {
      one.emplace(scenario);
    }
  }
  EventLoop& loop() { return one ? one->loop() : many ? many->loop() : with_another->loop(); }
  Bus& bus() { return one ? one->bus() : many ? many->bus() : with_another->bus(); }
  void run(Instant end) {
    if (one) {
      run_with_progress(*one, end);
    } else if (with_another) {
      with_another->run();
      tell_of_others(with_another->manager());
    } else {
      many->run();
      tell_of_losses(many->manager());
      tell_of_others(many->manager());
    }
  }
};

int run(const RunOptions& options) {
  if (options.keys) {
    fmt::print("{}", describe_scenario_keys());
    return kExitOk;
  }
  const Scenario scenario = checked_scenario(options);
  std::optional<OutputFolder> folder;
  if (!options.out.empty()) folder.emplace(options.out, scenario);

  const double start_s = wall_seconds();
  const Instant end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
  Way way(options, scenario);
  FleetObserver observer(fleet_members(scenario), way.loop(), way.bus());
  std::optional<ChannelWatch> channel;
  if (way.one && observer.is_one()) {
    channel.emplace(scenario.get<ChannelSettings>(), channel_traffic(scenario, true), way.loop(),
                    way.one->netem().uplink(), way.one->netem().downlink());
  }
  if (folder) folder->record(way.loop(), way.bus());
  std::optional<ViewedRun> viewed;
  if (options.view) viewed.emplace(options, scenario, *way.one);
  try {
    if (way.one) notice_signals();
    if (viewed) {
      viewed->run(end);
    } else {
      way.run(end);
    }
  } catch (const std::exception& error) {  // rows written so far stay
    if (folder) folder->write_incomplete(observer, error.what());
    throw;
  }

  RunSummary summary{
      .wall_time_s = wall_seconds() - start_s, .sim_time_s = to_seconds(end), .end = end};
  if (channel) summary.channel = channel->report(end);
  if (way.many) summary.lockstep = way.many->cost();
  summary.tube_m = tube_m(scenario);
  observer.check_finite();
  if (scenario.get<ControllerSettings>().is_external()) observer.check_commands();
  report(options, scenario, observer, summary, folder);
  return kExitOk;
}

}  // namespace

void add_run_command(CLI::App& tether, Action& action) {
  auto options = std::make_shared<RunOptions>();
  CLI::App* command = tether.add_subcommand("run", "Make one run in virtual time: deterministic");
  add_scenario(*command, options->scenario);
  add_seed(*command, options->scenario);
  command->add_option(
      "--out", options->out,
      "folder for scenario.toml, summary.json, trajectory.csv, run.lcmlog, path.png, "
      "path.svg [none]");
  CLI::Option* processes =
      command->add_flag("--processes", options->processes,
                        "run each node as its own process, over LCM in lockstep: the same result");
  command->add_option(
      "--lcm-url", options->lcm_url,
      "LCM network of --processes and of an external controller [a free port of this "
      "host's]");
  command
      ->add_option("--patience", options->patience_s,
                   "maximum time of a node of --processes for one answer, and for joining if above "
                   "20 s, s")
      ->check(number_between(0.1, 86'400.0))
      ->capture_default_str()
      ->needs(processes);
  command
      ->add_flag("--step", options->step,
                 "hold a run of --processes, and step it from the terminal")
      ->needs(processes);
  CLI::Option* const view =
      command->add_flag("--view", options->view, "show the run in the browser, paced by --speed")
          ->excludes(processes);
  command->add_option("--speed", options->speed, "with --view: run seconds per wall second")
      ->check(number_between(Playback::kSlowest, Playback::kFastest))
      ->capture_default_str()
      ->needs(view);
  add_view_options(*command, options->viewing, view);
  command->add_flag("--json", options->json, "print the summary as one JSON object");
  command->add_flag("--keys", options->keys, "list all scenario keys with units and defaults");
  command->callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace tether
