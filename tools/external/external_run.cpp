#include "tools/external/external_run.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>
#include <utility>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/external_command.hpp"

namespace tether {
namespace {

constexpr char kGuest[] = "controller";
/// For an interpreter to start.
constexpr Duration kLeastJoinPatience = std::chrono::seconds{20};
/// Time for the user to start a controller manually.
constexpr Duration kPatienceForPeople = std::chrono::minutes{5};
constexpr std::chrono::seconds kEndPatience{2};

TimeManager::Config config_of(const Scenario& scenario, std::int64_t session,
                              const std::vector<std::string>& nodes) {
  const auto& settings = scenario.get<ControllerSettings>();
  TimeManager::Config config;
  config.session = session;
  config.nodes = nodes;
  config.owners = channel_owners(fleet_members(scenario));
  config.end = kStart + from_seconds(scenario.get<RunSettings>().duration_s);
  config.patience = from_seconds(settings.patience_s);
  config.join_patience =
      settings.command.empty() ? kPatienceForPeople : std::max(kLeastJoinPatience, config.patience);
  config.probe_every = 0;
  return config;
}

}  // namespace

void tell_of_controller(const std::string& line) { fmt::print(stderr, "controller: {}\n", line); }

ExternalController::ExternalController(const std::string& lcm_url, ExternalProgram::OnLine tell)
    : url_(lcm_url), tell_(std::move(tell)) {
  if (url_.empty()) url_ = port_.emplace().lcm_url();
  url_ = checked_lcm_url(url_);
  if (multicast_group(url_).empty()) {
    throw UsageError(fmt::format("--lcm-url: a run in lockstep needs udpm://, not {}", url_));
  }
}

void ExternalController::begin(const Scenario& scenario, std::size_t arm, EventLoop& loop,
                               std::function<void(const std::string&)> on_end) {
  const auto& settings = scenario.get<ControllerSettings>();
  if (settings.command.empty()) return;
  if (!folder_) folder_.emplace();
  const std::string file = (folder_->path() / "scenario.toml").string();
  std::ofstream(file) << to_toml(scenario);
  const std::map<std::string, std::string> places{
      {"url", url_},
      {"scenario", file},
      {"seed", std::to_string(scenario.get<RunSettings>().seed)},
      {"arm", std::to_string(arm)}};
  // In quotes for the shell: a URL has a question mark.
  const std::string command = filled_in(
      settings.command, [&](const std::string& name) { return "'" + places.at(name) + "'"; });
  const bool serves = program_ && command == command_ && !program_->ends_within({});
  warm_ = settings.warm;
  if (!serves) {
    program_.reset();
    command_ = command;
    program_ = std::make_unique<ExternalProgram>(command, [this](const std::string& line) {
      if (tell_) tell_(line);
    });
  }
  program_->watch(loop, std::move(on_end));
}

void ExternalController::end(bool complete) {
  if (!program_ || (complete && warm_)) return;
  if (complete) program_->ends_within(kEndPatience);
  program_.reset();
}

ExternalRun::ExternalRun(const Scenario& scenario, ExternalController& controller, std::size_t arm)
    : scenario_(scenario),
      controller_(controller),
      arm_(arm),
      end_(kStart + from_seconds(scenario.get<RunSettings>().duration_s)),
      loop_(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
      bus_(loop_),
      io_(RealTimeLoop::wall_utime_us()),
      wire_(controller.url(), io_),
      nodes_(lockstep_nodes_of(scenario)),
      session_(RealTimeLoop::number_of_this_start()),
      hosts_(scenario_, session_, nodes_, kGuest, io_, wire_) {
  manager_ = std::make_unique<TimeManager>(
      config_of(scenario, session_, nodes_), io_, hosts_.bus(),
      [this](Instant when, const Message& message) { record(when, message); });
  hosts_.join();
}

void ExternalRun::record(Instant when, const Message& message) {
  loop_.run_until(when);
  bus_.publish(message.channel, message.bytes);
  loop_.run_until(when);
}

void ExternalRun::run() {
  struct End {  // whatever happens
    ExternalController& controller;
    bool complete = false;
    ~End() { controller.end(complete); }
  } end{controller_};
  if (scenario_.get<ControllerSettings>().command.empty()) {
    fmt::print(stderr, "tether: waiting for the node \"{}\" of session {} on {}\n", kGuest,
               session_, controller_.url());
  }
  bool was_killed = false;
  controller_.begin(scenario_, arm_, io_, [this, &was_killed](const std::string& how) {
    if (ending_) return;
    was_killed = manager_->error().empty() && controller_.was_killed();
    manager_->on_node_gone(kGuest, how);
  });
  manager_->announce();
  io_.run();
  ending_ = true;
  manager_->dismiss();
  if (!manager_->done()) {
    const std::string why = manager_->error();
    if (was_killed || manager_->disturbed()) throw NoResult(why);
    if (!why.empty()) throw std::runtime_error(why);
    if (const std::string error = hosts_.error(); !error.empty()) throw std::runtime_error(error);
    throw NoResult(
        fmt::format("ended by signal {} at t = {:.3f} s", io_.signal(), to_seconds(loop_.now())));
  }
  loop_.run_until(end_);
  end.complete = true;
}

}  // namespace tether
