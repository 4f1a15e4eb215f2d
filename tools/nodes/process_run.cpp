#include "tools/nodes/process_run.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "common/base/errors.hpp"
#include "common/base/share.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "tools/base/process.hpp"
#include "tools/nodes/external_run.hpp"
#include "tools/nodes/hosted_nodes.hpp"

namespace tether {

StepConsole::StepConsole(EventLoop& io, TimeManager& manager, int fd)
    : io_(io), manager_(manager), fd_(fd) {
  fmt::print(stderr,
             "Enter or s [N]: one grant, or N   u SECONDS: run until   c: go on   p: pause   q: "
             "quit\n");
  manager_.hold(Instant::min());
  // This is called in the middle of the manager's work, so the position is shown after it.
  manager_.on_held([this] {
    io_.at(io_.now(), Priority::node, [this](Instant) {
      if (manager_.held()) show();
    });
  });
  try {
    io_.add_fd(fd_, [this](Instant) { read_input(); });
  } catch (const std::system_error&) {  // a file, which is never waited for
    while (read_some()) {
    }
    fd_ = -1;
  }
}

StepConsole::~StepConsole() {
  if (fd_ >= 0) io_.remove_fd(fd_);
}

void StepConsole::read_input() {
  if (!read_some()) {
    io_.remove_fd(fd_);
    fd_ = -1;
  }
  take_lines();
}

/// False at the end of the input.
bool StepConsole::read_some() {
  std::array<char, 1024> buffer{};
  const ssize_t size = read(fd_, buffer.data(), buffer.size());
  at_end_ = size <= 0;
  if (!at_end_) input_.append(buffer.data(), static_cast<std::size_t>(size));
  for (auto end = input_.find('\n'); end != std::string::npos; end = input_.find('\n')) {
    const std::string line = input_.substr(0, end);
    input_.erase(0, end + 1);
    const bool at_once = line == "p" || line == "q";
    if (at_once) {
      lines_.clear();
      obey(line);
    } else {
      lines_.push_back(line);
    }
  }
  return !at_end_;
}

void StepConsole::take_lines() {
  while (!lines_.empty() && manager_.held()) {
    const std::string line = lines_.front();
    lines_.pop_front();
    obey(line);
  }
  if (at_end_ && lines_.empty() && manager_.held()) manager_.hold(Instant::max());
}

void StepConsole::show() {
  if (steps_left_ > 0) --steps_left_;
  const std::string& story = manager_.story();
  fmt::print(stderr, "t = {:.6f} s{}{}\n", to_seconds(manager_.next()),
             story.empty() ? "" : " is next, after ", story);
  if (steps_left_ > 0) {
    manager_.step();
  } else {
    take_lines();
  }
}

void StepConsole::obey(const std::string& line) {
  std::istringstream words(line);
  std::string word;
  words >> word;
  double value = 0.0;
  const bool has_value = static_cast<bool>(words >> value);
  if (word.empty() || word == "s") {
    steps_left_ = has_value ? static_cast<int>(std::clamp(value, 1.0, 1e9)) : 1;
    manager_.hold(Instant::min());
    manager_.step();
  } else if (word == "u" && has_value && std::abs(value) < 1e9) {
    manager_.hold(kStart + from_seconds(value));
  } else if (word == "c") {
    manager_.hold(Instant::max());
  } else if (word == "p") {
    steps_left_ = 0;
    manager_.hold(Instant::min());
  } else if (word == "q") {
    manager_.fail("ended from the terminal");
  } else {
    fmt::print(stderr, "not understood: {}\n", line);
  }
}

namespace {

/// Time after the start of the first message on what it waits for, and the interval of later ones.
constexpr Duration kFirstWord = std::chrono::seconds{3};
constexpr Duration kNextWord = std::chrono::seconds{20};

/// Whether the process was stopped (SIGSTOP, a debugger): state T or t of proc(5).
bool is_stopped(pid_t pid) {
  std::ifstream in(fmt::format("/proc/{}/stat", pid));
  std::string stat;
  std::getline(in, stat);
  const auto name_ends = stat.rfind(')');  // the name may hold anything
  if (name_ends == std::string::npos || name_ends + 2 >= stat.size()) return false;
  return stat[name_ends + 2] == 'T' || stat[name_ends + 2] == 't';
}

std::string url_of(const std::string& wanted, std::optional<ReservedPort>& port) {
  std::string url = checked_lcm_url(wanted.empty() ? port.emplace().lcm_url() : wanted);
  if (multicast_group(url).empty()) {
    throw UsageError(fmt::format("--lcm-url: a run in lockstep needs udpm://, not {}", url));
  }
  return url;
}

}  // namespace

ProcessRun::ProcessRun(const Options& options, const Scenario& scenario)
    : end_(kStart + from_seconds(scenario.get<RunSettings>().duration_s)),
      loop_(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
      bus_(loop_),
      url_(url_of(options.lcm_url, port_)),
      io_(RealTimeLoop::wall_utime_us()),
      wire_(url_, io_) {
  TimeManager::Config config;
  config.session = RealTimeLoop::number_of_this_start();
  config.nodes = lockstep_nodes_of(scenario);
  config.owners = channel_owners(fleet_members(scenario));
  config.end = end_;
  config.patience = from_seconds(options.patience_s);
  config.join_patience = std::max(config.join_patience, config.patience);
  if (!scenario.get<ControllerSettings>().command.empty()) {
    guest_.emplace(url_, tell_of_controller);
    begin_guest_ = [this, scenario] {
      guest_->begin(scenario, 0, io_, [this](const std::string& how) {
        if (!ending_) manager_->on_node_gone("controller", how);
      });
    };
  } else if (scenario.get<ControllerSettings>().external) {
    config.join_patience = std::max(kPatienceForPeople, config.patience);
    fmt::print(stderr, "tether: waiting for the node \"controller\" of session {} on {}\n",
               config.session, url_);
  }
  manager_ = std::make_unique<TimeManager>(
      config, io_, wire_, [this](Instant when, const Message& message) { record(when, message); });
  if (options.step) {
    fmt::print(stderr, "tether: on {}\n", url_);
    console_.emplace(io_, *manager_, STDIN_FILENO);
  }
  for (const std::string& node : config.nodes) {
    const auto& controller = scenario.get<ControllerSettings>();
    const bool elsewhere = node == "controller" && controller.is_external() && !controller.ros2;
    if (elsewhere) continue;
    const bool is_door = node == "controller" && controller.ros2;
    start_node(options, node, is_door ? "tether-ros2" : "tether-" + node, config.session);
  }
}

void ProcessRun::start_node(const Options& options, const std::string& node,
                            const std::string& program_name, std::int64_t session) {
  const std::string program = (executable_folder() / program_name).string();
  if (access(program.c_str(), X_OK) != 0) {
    throw std::runtime_error(fmt::format("cannot start {}: {}; tether expects its nodes beside it",
                                         program, std::generic_category().message(errno)));
  }
  std::vector<std::string> command{program, options.scenario_file, "--lcm-url=" + url_,
                                   fmt::format("--lockstep={}", session)};
  for (const std::string& text : options.overrides) command.push_back("--set=" + text);
  const auto on_exit = [this, node](int code) {
    if (ending_) return;
    manager_->on_node_gone(node, code > 128 ? fmt::format("was killed by signal {}", code - 128)
                                            : fmt::format("ended with exit code {}", code));
  };
  children_.push_back(
      {node, std::make_unique<NodeProcess>(
                 io_, std::move(command),
                 [](const std::string& line) { fmt::print(stderr, "{}\n", line); }, on_exit)});
}

void ProcessRun::record(Instant when, const Message& message) {
  loop_.run_until(when);
  bus_.publish(message.channel, message.bytes);
  loop_.run_until(when);
}

/// While it waits: for whom, and whether anybody could be heard at all.
void ProcessRun::say_who_is_missing() {
  if (manager_->started() || ending_) return;
  fmt::print(stderr, "tether: still waiting for {} on {}\n",
             fmt::join(manager_->missing(), " and "), url_);
  CounterList network;
  wire_.list_counters(network);
  const bool comes_back = std::any_of(network.begin(), network.end(), [](const auto& counter) {
    return counter.first == "datagrams_own" && counter.second > 0;
  });
  if (comes_back) return;
  fmt::print(stderr,
             "tether: nor do its own messages come back: tether doctor --lcm-url '{}' says why\n",
             url_);
}

void ProcessRun::run() {
  for (Child& child : children_) child.process->start();
  if (begin_guest_) begin_guest_();
  io_.every(io_.now() + kFirstWord, kNextWord, Priority::observer,
            [this](Instant) { say_who_is_missing(); });
  io_.run();
  if (!manager_->done()) {
    // Who waits for a node that is stopped can only say that messages do not come.
    const std::string stopped = stopped_node();
    const std::string why = stopped.empty() ? manager_->error() : stopped;
    manager_->dismiss();
    throw std::runtime_error(!why.empty() ? why
                                          : fmt::format("ended by signal {} at t = {:.3f} s",
                                                        io_.signal(), to_seconds(loop_.now())));
  }
  loop_.run_until(end_);
  end_nodes();
}

std::string ProcessRun::stopped_node() const {
  if (manager_->error().empty()) return "";
  for (const Child& child : children_) {
    if (!child.process->running() || !is_stopped(child.process->pid())) continue;
    const std::string& why = manager_->error();
    const std::string silent = child.node + " did not ";  // answer, join
    return fmt::format("{}: its process {} is stopped (kill -CONT {} continues it)",
                       why.starts_with(silent) ? why : silent + "answer", child.process->pid(),
                       child.process->pid());
  }
  return "";
}

LockstepCost ProcessRun::cost() const {
  const TimeManager::Counters& c = manager_->counters();
  LockstepCost cost{.grants = c.grants, .wall_time_s = to_seconds(c.wall_time)};
  if (!c.round_trips.empty()) {
    std::vector<Duration> sorted = c.round_trips;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    cost.round_trip_s = to_seconds(*middle);
  }
  return cost;
}

void ProcessRun::end_nodes() {
  ending_ = true;
  manager_->dismiss();
  const Instant deadline = io_.now() + kEndPatience;
  const auto alive = [this] {
    return std::any_of(children_.begin(), children_.end(),
                       [](const Child& child) { return child.process->running(); });
  };
  while (alive() && io_.now() < deadline) io_.run_until(io_.now() + std::chrono::milliseconds{5});
  if (guest_) guest_->end(true);
}

}  // namespace tether
