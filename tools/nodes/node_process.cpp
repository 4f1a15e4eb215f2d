#include "tools/nodes/node_process.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <utility>

#include "common/base/errors.hpp"
#include "tools/base/process.hpp"

namespace tether {

NodeProcess::NodeProcess(RealTimeLoop& loop, std::vector<std::string> command, OnLine on_line,
                         OnExit on_exit)
    : loop_(loop),
      command_(std::move(command)),
      on_line_(std::move(on_line)),
      on_exit_(std::move(on_exit)) {}

NodeProcess::~NodeProcess() {
  if (!running()) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
  close(pid_fd_);
  close(stderr_fd_);
}

void NodeProcess::start() {
  std::array<int, 2> pipe_fds{};
  check_system_call("opening a pipe", pipe2(pipe_fds.data(), O_CLOEXEC));
  const std::vector<char*> argv = to_argv(command_);
  const pid_t parent = getpid();
  pid_ = check_system_call("starting " + command_.front(), fork());
  if (pid_ == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != parent) _exit(1);  // the parent died before the line above
    setpgid(0, 0);
    dup2(pipe_fds[1], STDERR_FILENO);
    execv(argv.front(), argv.data());
    _exit(127);
  }
  close(pipe_fds[1]);
  stderr_fd_ = pipe_fds[0];
  fcntl(stderr_fd_, F_SETFL, O_NONBLOCK);
  pid_fd_ = check_system_call("watching " + command_.front(),
                              static_cast<int>(syscall(SYS_pidfd_open, pid_, 0)));
  loop_.add_fd(stderr_fd_, [this](Instant) { read_stderr(); });
  loop_.add_fd(pid_fd_, [this](Instant) { on_exit(); });
}

void NodeProcess::send_signal(int signal) const {
  if (running()) kill(pid_, signal);
}

void NodeProcess::on_exit() {
  if (!running()) return;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return;
  pid_ = -1;
  read_stderr();
  for (const int fd : {pid_fd_, stderr_fd_}) {
    loop_.remove_fd(fd);
    close(fd);
  }
  on_exit_(WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status));
}

void NodeProcess::read_stderr() {
  std::array<char, 4096> buffer{};
  ssize_t size = 0;
  while ((size = read(stderr_fd_, buffer.data(), buffer.size())) > 0) {
    partial_line_.append(buffer.data(), static_cast<std::size_t>(size));
  }
  for (auto end = partial_line_.find('\n'); end != std::string::npos;
       end = partial_line_.find('\n')) {
    on_line_(partial_line_.substr(0, end));
    partial_line_.erase(0, end + 1);
  }
  // At end of file the pipe stays readable; the exit follows, until then do not spin.
  if (size == 0) loop_.remove_fd(stderr_fd_);
}

}  // namespace tether
