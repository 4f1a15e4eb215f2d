#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/bus/lcm_bus.hpp"
#include "common/loop/real_time_loop.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/can/arm_operator.hpp"
#include "tools/processes/node_process.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// A live run: starts sim, netem, controller and, with drives on CAN, bridge and emulated drives as
/// processes on one LCM network, arms the drives, watches the processes and their messages, and
/// ends them in order. A node that dies is started again and joins the run at the right time (the
/// run says how often that happened). A node that refuses to start, or fails before it has run for
/// the first time, ends the run.
class LiveSession {
 public:
  struct Options {
    std::string scenario_file;
    std::vector<std::string> overrides;  ///< passed on to the nodes
    std::string lcm_url;
    std::string out;          ///< folder for results; empty for none
    double speed = 1.0;       ///< run seconds per wall second
    bool show_status = true;  ///< status line on stderr
  };

  LiveSession(const Options& options, const Scenario& scenario);

  /// Runs to the scenario's end or until Ctrl-C. Throws if a node cannot run at all.
  void run();

  const RunObserver& observer() const { return observer_; }
  /// Run time when it ended.
  Instant end() const { return end_; }
  int restarts() const { return restarts_; }
  bool interrupted() const { return loop_.signal() != 0; }
  const std::optional<OutputFolder>& folder() const { return folder_; }
  std::optional<OutputFolder>& folder() { return folder_; }

 private:
  struct Child {
    std::string name;
    std::unique_ptr<NodeProcess> process;
    bool has_run = false;
  };
  void add_child(const Options& options, const std::string& name);
  void on_child_exit(Child& child, int code);
  void say(const std::string& line);
  void show_status();
  void shut_down();
  std::string drives() const;

  bool show_status_;
  bool ending_ = false;
  const Child* ending_child_ = nullptr;
  Instant end_;
  RealTimeLoop loop_;
  LcmBus bus_;
  RunObserver observer_;
  ArmOperator operator_;
  std::optional<OutputFolder> folder_;
  std::vector<std::unique_ptr<Child>> children_;
  int restarts_ = 0;
  std::string failure_;
  std::int64_t last_poses_ = 0;
  std::int64_t last_commands_ = 0;
};

}  // namespace tether
