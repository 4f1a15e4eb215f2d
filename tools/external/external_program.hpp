#pragma once

#include <sys/types.h>

#include <chrono>
#include <functional>
#include <string>

#include "common/loop/event_loop.hpp"

namespace tether {

/// An external command as a child process: by /bin/sh in the current folder, with nothing on its
/// standard input, in a process group of its own, which is killed with this, and when the thread
/// that started it ends.
class ExternalProgram {
 public:
  /// Called with each line that it writes.
  using OnLine = std::function<void(const std::string& line)>;

  /// Starts it. Throws std::system_error.
  ExternalProgram(const std::string& command, OnLine on_line);
  ~ExternalProgram();
  ExternalProgram(const ExternalProgram&) = delete;
  ExternalProgram& operator=(const ExternalProgram&) = delete;

  /// Reads what it writes, and calls `on_end`, in calls of `loop`, which must not outlive this;
  /// `how`: "ended with exit code 1: " and the last line that it wrote.
  void watch(EventLoop& loop, std::function<void(const std::string& how)> on_end);

  /// Whether a signal ended it, or its command if the shell says so: by its exit code, 128 and the
  /// signal's number. Known from `on_end` on.
  bool was_killed() const;

  /// Whether it ends, or has ended, within this time.
  bool ends_within(std::chrono::milliseconds time);

 private:
  bool has_ended();
  bool read_lines();  ///< false: there will be no more
  std::string how_it_ended() const;

  OnLine on_line_;
  pid_t pid_ = -1;
  pid_t guard_ = -1;  ///< a process that ends it if this cannot
  int pid_fd_ = -1;
  int pipe_fd_ = -1;
  bool ended_ = false;
  int status_ = 0;
  std::string partial_line_, last_line_;
};

}  // namespace tether
