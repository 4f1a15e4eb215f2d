#include "tools/external/external_program.hpp"

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
#include <string_view>
#include <utility>

#include "common/base/system_error.hpp"
#include "common/base/text.hpp"

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

}  // namespace tether
