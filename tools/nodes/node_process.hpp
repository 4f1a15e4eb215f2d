#pragma once

#include <sys/types.h>

#include <functional>
#include <string>
#include <vector>

#include "common/node/real_time_loop.hpp"

namespace tether {

/// A node as a child process that is watched by an event loop. It has a process group of its own,
/// so that Ctrl-C reaches only its parent, and it ends when its parent dies, however that happens.
class NodeProcess {
 public:
  /// Called when the child has ended: `code` is its exit code, or 128 + signal.
  using OnExit = std::function<void(int code)>;
  /// Called with each line that the child writes to stderr.
  using OnLine = std::function<void(const std::string& line)>;

  NodeProcess(RealTimeLoop& loop, std::vector<std::string> command, OnLine on_line, OnExit on_exit);
  ~NodeProcess();
  NodeProcess(const NodeProcess&) = delete;
  NodeProcess& operator=(const NodeProcess&) = delete;

  void start();
  bool running() const { return pid_ > 0; }
  /// −1 while it does not run.
  pid_t pid() const { return pid_; }
  void send_signal(int signal) const;

 private:
  void on_exit();
  void read_stderr();

  RealTimeLoop& loop_;
  std::vector<std::string> command_;
  OnLine on_line_;
  OnExit on_exit_;
  pid_t pid_ = -1;
  int pid_fd_ = -1;
  int stderr_fd_ = -1;
  std::string partial_line_;
};

}  // namespace tether
