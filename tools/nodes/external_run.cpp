#include "tools/nodes/external_run.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <fstream>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/text.hpp"
#include "common/fleet/fleet.hpp"
#include "common/lcm/lcm_url.hpp"
#include "common/scenario/run_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/external_command.hpp"

namespace tether {
namespace {

constexpr std::size_t kLongestLine = 4096;

/// In the child; only what is allowed between fork() and exec. Waits for a count of `start_fd`: a
/// command that runs without its guard would outlive a parent that is killed.
[[noreturn]] void become(const char* command, pid_t parent, int start_fd, int out_fd) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(1);  // the parent died before the line above
  eventfd_t guarded = 0;
  if (eventfd_read(start_fd, &guarded) != 0) _exit(1);
  setpgid(0, 0);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const int nothing = open("/dev/null", O_RDONLY);
  dup2(nothing, STDIN_FILENO);
  dup2(out_fd, STDOUT_FILENO);
  dup2(out_fd, STDERR_FILENO);
  execl("/bin/sh", "sh", "-c", command, static_cast<char*>(nullptr));
  _exit(127);
}

/// In another child: kills the program's group when the thread that started it is gone. Shells do
/// not hand on the kernel's word of that.
[[noreturn]] void guard(pid_t program, pid_t parent) {
  sigset_t end;
  sigemptyset(&end);
  sigaddset(&end, SIGTERM);
  sigprocmask(SIG_SETMASK, &end, nullptr);
  setpgid(0, 0);
  close_range(0, ~0U, 0);
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() == parent) sigwaitinfo(&end, nullptr);
  kill(-program, SIGKILL);
  _exit(0);
}

}  // namespace

ExternalProgram::ExternalProgram(const std::string& command, OnLine on_line)
    : on_line_(std::move(on_line)) {
  const int start_fd = check_system_call("opening an event", eventfd(0, EFD_CLOEXEC));
  std::array<int, 2> pipe_fds{};
  check_system_call("opening a pipe", pipe2(pipe_fds.data(), O_CLOEXEC));
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ == 0) become(command.c_str(), parent, start_fd, pipe_fds[1]);
  close(pipe_fds[1]);
  pipe_fd_ = pipe_fds[0];
  if (pid_ > 0) setpgid(pid_, pid_);  // here too, because either may be first
  if (pid_ > 0) guard_ = fork();
  if (guard_ == 0) guard(pid_, parent);
  if (guard_ < 0) {
    const std::system_error error(errno, std::generic_category(), "starting " + command);
    if (pid_ > 0) kill(pid_, SIGKILL);
    if (pid_ > 0) waitpid(pid_, nullptr, 0);
    close(start_fd);
    close(pipe_fd_);
    throw error;
  }
  eventfd_write(start_fd, 1);
  close(start_fd);
  fcntl(pipe_fd_, F_SETFL, O_NONBLOCK);
  pid_fd_ = static_cast<int>(syscall(SYS_pidfd_open, pid_, 0));
}

ExternalProgram::~ExternalProgram() {
  if (guard_ > 0) {
    kill(guard_, SIGKILL);
    waitpid(guard_, nullptr, 0);
  }
  if (!ended_) {
    kill(-pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  close(pid_fd_);
  close(pipe_fd_);
}

void ExternalProgram::watch(EventLoop& loop, std::function<void(const std::string&)> on_end) {
  loop.add_fd(pipe_fd_, [this, &loop](Instant) {
    // At end of file the pipe stays readable; do not spin.
    if (!read_lines()) loop.remove_fd(pipe_fd_);
  });
  loop.add_fd(pid_fd_, [this, &loop, on_end = std::move(on_end)](Instant) {
    if (!has_ended()) return;
    loop.remove_fd(pid_fd_);
    read_lines();
    on_end(how_it_ended());
  });
}

bool ExternalProgram::has_ended() {
  if (ended_) return true;
  siginfo_t info{};
  waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOHANG | WNOWAIT);
  if (info.si_pid != pid_) return false;
  kill(-pid_, SIGKILL);  // its remaining children; until it is waited for, the number is its own
  waitpid(pid_, &status_, 0);
  return ended_ = true;
}

bool ExternalProgram::ends_within(std::chrono::milliseconds time) {
  const auto deadline = std::chrono::steady_clock::now() + time;
  while (!has_ended()) {
    read_lines();  // it may wait for that
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        deadline - std::chrono::steady_clock::now());
    if (left.count() <= 0) return false;
    std::array<pollfd, 2> fds{{{pid_fd_, POLLIN, 0}, {pipe_fd_, POLLIN, 0}}};
    poll(fds.data(), fds.size(), static_cast<int>(std::min<std::int64_t>(left.count(), 20)));
  }
  read_lines();
  return true;
}

bool ExternalProgram::read_lines() {
  std::array<char, 4096> buffer{};
  ssize_t size = 0;
  while ((size = read(pipe_fd_, buffer.data(), buffer.size())) > 0) {
    for (const char c : std::string_view(buffer.data(), static_cast<std::size_t>(size))) {
      if (c != '\n' && partial_line_.size() < kLongestLine) {
        partial_line_ += c;
        continue;
      }
      if (c != '\n') continue;
      if (!partial_line_.empty()) last_line_ = partial_line_;
      on_line_(partial_line_);
      partial_line_.clear();
    }
  }
  return size != 0;
}

bool ExternalProgram::was_killed() const {
  const int code = WIFEXITED(status_) ? WEXITSTATUS(status_) : 0;
  return ended_ && (WIFSIGNALED(status_) || (code > 128 && code <= 128 + SIGRTMAX));
}

std::string ExternalProgram::how_it_ended() const {
  std::string how = WIFSIGNALED(status_)
                        ? fmt::format("was killed by signal {}", WTERMSIG(status_))
                        : fmt::format("ended with exit code {}", WEXITSTATUS(status_));
  const std::string& last = partial_line_.empty() ? last_line_ : partial_line_;
  if (!last.empty()) how += fmt::format(", saying \"{}\"", printable(last, 200));
  return how;
}

namespace {

constexpr char kGuest[] = "controller";
/// For an interpreter to start.
constexpr Duration kLeastJoinPatience = std::chrono::seconds{20};

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
