#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/lcm/udpm_bus.hpp"
#include "common/node/event_loop.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/base/reserved_port.hpp"
#include "tools/nodes/external_run.hpp"
#include "tools/nodes/node_process.hpp"
#include "tools/nodes/time_manager.hpp"
#include "tools/runs/run_summary.hpp"

namespace tether {

/// Holds a run in lockstep and steps it, by lines from a terminal or a pipe:
///   (empty) or s [N]   one grant, or N of them
///   u SECONDS          run until this time
///   c                  go on to the end
///   p                  stop at once
///   q                  end the run
/// Lines wait until the run stands still. Only p and q act at once, and the lines that wait are
/// then forgotten. Says where the run stands each time it comes to stand still. When the input
/// ends, the run goes on.
class StepConsole {
 public:
  /// Holds the run from its beginning. All must outlive the console.
  StepConsole(EventLoop& io, TimeManager& manager, int fd);
  ~StepConsole();
  StepConsole(const StepConsole&) = delete;
  StepConsole& operator=(const StepConsole&) = delete;

 private:
  void read_input();
  bool read_some();
  void take_lines();
  void obey(const std::string& line);
  void show();

  EventLoop& io_;
  TimeManager& manager_;
  int fd_;
  std::string input_;              // an unfinished line
  std::deque<std::string> lines_;  // waiting lines
  bool at_end_ = false;            // end of the input
  int steps_left_ = 0;
};

/// A run in virtual time whose nodes are processes on an LCM network, in lockstep
/// (docs/reference/time.md): the same messages in the same order as ClosedLoop has them.
class ProcessRun {
 public:
  struct Options {
    std::string scenario_file;
    std::vector<std::string> overrides;  ///< passed on to the nodes
    std::string lcm_url;                 ///< empty: a free port of this host's
    double patience_s = 10.0;            ///< for a node that owes an answer
    bool step = false;                   ///< the run obeys the terminal
  };

  ProcessRun(const Options& options, const Scenario& scenario);

  /// For observers, which subscribe before the run.
  Bus& bus() { return bus_; }
  EventLoop& loop() { return loop_; }

  /// Runs to the end. Throws std::runtime_error that names the node that kept it from there.
  void run();

  /// Where the run has come to.
  Instant now() const { return loop_.now(); }
  const TimeManager& manager() const { return *manager_; }
  LockstepCost cost() const;

 private:
  void start_node(const Options& options, const std::string& node, const std::string& program_name,
                  std::int64_t session);
  void record(Instant when, const Message& message);
  void end_nodes();
  void say_who_is_missing();
  std::string stopped_node() const;  // why a run broke off, if that is it

  struct Child {
    std::string node;
    std::unique_ptr<NodeProcess> process;
  };

  Instant end_;
  VirtualLoop loop_;
  InProcessBus bus_;
  std::optional<ReservedPort> port_;
  std::string url_;
  std::optional<ExternalController> guest_;  ///< if controller.command says so
  std::function<void()> begin_guest_;
  RealTimeLoop io_;
  UdpmBus wire_;
  std::unique_ptr<TimeManager> manager_;
  std::optional<StepConsole> console_;
  std::vector<Child> children_;
  bool ending_ = false;
};

}  // namespace tether
