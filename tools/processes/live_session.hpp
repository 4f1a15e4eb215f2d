#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/bus/sole_sender.hpp"
#include "common/lcm/own_addresses.hpp"
#include "common/loop/real_time_loop.hpp"
#include "common/program/presence.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/can/arm_operator.hpp"
#include "tools/external/external_run.hpp"
#include "tools/processes/dashboard.hpp"
#include "tools/processes/node_process.hpp"
#include "tools/processes/run_watch.hpp"
#include "tools/processes/terminal_status.hpp"
#include "tools/runs/fleet_observer.hpp"
#include "tools/runs/output_folder.hpp"

namespace tether {

/// A live run: starts sim, netem, controller and, with drives on CAN, bridge and emulated drives as
/// processes on one LCM network, arms the drives, watches the processes and their messages, and
/// ends them in order. A node that dies is started again and joins the run at the right time (the
/// run says how often that happened); so does one that hangs, after it was ended. A node that
/// refuses to start, or fails before it has run for the first time, ends the run; so does an
/// external controller (controller.command), whenever it ends.
///
/// The network has to be its own: a run that finds another there does not start, and whatever else
/// makes it another run than it says (RunWatch, SoleSender) is said at once and in findings().
class LiveSession {
 public:
  struct Options {
    std::string scenario_file;
    std::vector<std::string> overrides;  ///< passed on to the nodes
    std::string lcm_url;
    std::string out;          ///< folder for results; empty for none
    double speed = 1.0;       ///< run seconds per wall second
    bool show_status = true;  ///< if stderr is a terminal: a dashboard, or a line if it is small
    /// Options of a `tether view` beside the nodes; none: there is none.
    std::optional<std::vector<std::string>> view;
  };

  LiveSession(const Options& options, const Scenario& scenario);

  /// Runs to the scenario's end or until Ctrl-C. Throws if a node cannot run at all, or if another
  /// run is on the network.
  void run();

  const FleetObserver& observer() const { return observer_; }
  /// Run time when it ended.
  Instant end() const { return end_; }
  int restarts() const { return restarts_; }
  /// Reasons why the run is invalid, in words; empty if it is what it says.
  std::vector<std::string> findings() const;
  bool interrupted() const { return loop_.signal() != 0; }
  const std::optional<OutputFolder>& folder() const { return folder_; }
  std::optional<OutputFolder>& folder() { return folder_; }

 private:
  struct Child {
    std::string name;
    std::unique_ptr<NodeProcess> process;
    bool has_run = false;
  };
  void expect_no_company();
  void on_presence(const presence_t& presence, std::uint64_t sender);
  bool is_of_this_host(std::uint64_t sender);
  void watch_run();
  void start(Child& child);
  void add_child(const Options& options, const std::string& name);
  void add_view(const Options& options);
  void start_guest();
  void on_child_exit(Child& child, int code);
  void show_status();
  void shut_down();
  std::string drives() const;
  std::vector<Position> others() const;
  std::vector<std::string> silent() const;
  std::vector<std::string> mute_controllers() const;

  std::string url_;
  Scenario scenario_;
  TerminalStatus status_;
  Dashboard dashboard_;
  bool ending_ = false;
  const Child* ending_child_ = nullptr;
  Instant end_;
  RealTimeLoop loop_;
  std::unique_ptr<Bus> network_;
  std::unique_ptr<Bus> recorder_;  ///< hears what this session publishes, too
  Bus& bus_ = *network_;
  std::string vehicle_;
  std::optional<Presence> presence_;  ///< once the network is known to be its own
  RunWatch watch_;
  std::optional<OwnAddresses> own_addresses_;  ///< once the network tells who sends presences
  SoleSender senders_;
  FleetObserver observer_;
  ArmOperator operator_;
  std::optional<OutputFolder> folder_;
  std::vector<std::unique_ptr<Child>> children_;
  ExternalController guest_;           ///< program of controller.command, if there is one
  std::unique_ptr<NodeProcess> view_;  ///< only looks: the run goes on without it
  int restarts_ = 0;
  std::string failure_;
  std::string company_;  ///< another run that was here before; its `tether live`, if it has one
  bool starting_ = true;
  std::size_t findings_said_ = 0;
  std::int64_t undecodable_ = 0;
  RecentLink uplink_, downlink_;  ///< at the last updates of the status
};

}  // namespace tether
