#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/lcm/udpm_bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/base/reserved_port.hpp"
#include "tools/base/temporary_folder.hpp"
#include "tools/nodes/hosted_nodes.hpp"
#include "tools/nodes/time_manager.hpp"

namespace tether {

/// Time for the user to start a controller manually, and for a program to end when its run has.
inline constexpr Duration kPatienceForPeople = std::chrono::minutes{5};
inline constexpr std::chrono::seconds kEndPatience{2};

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

/// An external controller for runs one after another, on an LCM network of its own: the command of
/// controller.command, started for each run, or with controller.warm for the first and again after
/// a run that failed; without a command, any controller that joins.
class ExternalController {
 public:
  /// `lcm_url`: empty for a free port of this host's. `tell`: what a command writes.
  explicit ExternalController(const std::string& lcm_url = "", ExternalProgram::OnLine tell = {});

  const std::string& url() const { return url_; }

  /// Starts the command for this run of a sweep's arm, unless it serves already. Until end() the
  /// loop watches it: `on_end` as ExternalProgram has it.
  void begin(const Scenario& scenario, std::size_t arm, EventLoop& loop,
             std::function<void(const std::string& how)> on_end);
  /// Whether a signal ended the command of this run.
  bool was_killed() const { return program_ && program_->was_killed(); }
  /// The run is over; one that was not `complete` ends the program, and so does one that serves no
  /// other run and does not end by itself within two seconds. Before the loop is gone.
  void end(bool complete);

 private:
  std::optional<ReservedPort> port_;
  std::string url_;
  ExternalProgram::OnLine tell_;
  std::optional<TemporaryFolder> folder_;
  bool warm_ = false;
  std::string command_;  ///< command of the program
  std::unique_ptr<ExternalProgram> program_;
};

/// "controller: LINE" on standard error.
void tell_of_controller(const std::string& line);

/// A run has no result because a signal ended its controller, as when memory runs out, or the run
/// itself, or because another program took part.
class NoResult : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// A run in virtual time whose controller is an external program, in lockstep over LCM, and all
/// else in this thread: the same messages in the same order as ProcessRun has them.
class ExternalRun {
 public:
  /// `controller` must outlive it. `arm`: for the command.
  ExternalRun(const Scenario& scenario, ExternalController& controller, std::size_t arm = 0);

  /// For observers, which subscribe before the run.
  Bus& bus() { return bus_; }
  EventLoop& loop() { return loop_; }

  /// Runs to the end. Throws std::runtime_error that names the node that kept it from there;
  /// NoResult, as there.
  void run();
  /// After the run.
  const TimeManager& manager() const { return *manager_; }

 private:
  void record(Instant when, const Message& message);

  Scenario scenario_;
  ExternalController& controller_;
  std::size_t arm_;
  Instant end_;
  VirtualLoop loop_;
  InProcessBus bus_;
  RealTimeLoop io_;
  UdpmBus wire_;
  std::vector<std::string> nodes_;
  std::int64_t session_;
  HostedNodes hosts_;
  std::unique_ptr<TimeManager> manager_;
  bool ending_ = false;
};

}  // namespace tether
