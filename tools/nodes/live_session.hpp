#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <tether/presence_t.hpp>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/lcm/host_routes.hpp"
#include "common/node/bus.hpp"
#include "common/node/real_time_loop.hpp"
#include "common/node/sole_sender.hpp"
#include "common/program/presence.hpp"
#include "common/scenario/scenario.hpp"
#include "tools/can/arm_operator.hpp"
#include "tools/nodes/dashboard.hpp"
#include "tools/nodes/external_run.hpp"
#include "tools/nodes/node_process.hpp"
#include "tools/runs/output_folder.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {

/// Judges whether a live run is what it says: alone on its network, one of each program, all of
/// them alive. Pure; `now` is the run's time and must not go backwards, and all limits are on the
/// wall clock: `rate` says how many seconds of the run one of its seconds is.
///
/// - Another run: a presence of another run; its first is reported.
/// - An unknown sender: a program of this run and vehicle, of which one is there already (other
/// host or
///   process) and which this run has not started.
/// - Hung: an own program that is not heard for kSilence: stopped, in an endless loop, or cut off.
///   One that starts has until kPatience after its start, or after t = 0. After kPatience of
///   silence it is to be ended: hangs().
///
/// - Two senders that both say that they are one process.
/// - An unknown sender: one that sends on a channel of the run's programs, be it once, and is not
///   heard on RUN/PRESENCE within kSilence.
/// - A second controller: two senders on a channel of an external controller, be it once and one
///   after the other. So an external controller cannot be started again within a run.
///
/// - Late loops: what all programs together have added to the mean age of a message, if it had come
///   by way of all of them, is more than kMostLateness.
///
/// While the watch itself was suspended (two updates more than kSilence apart), no program counts
/// as silent.
class RunWatch {
 public:
  static constexpr Duration kSilence = std::chrono::milliseconds{1500};
  static constexpr Duration kPatience = std::chrono::seconds{5};

  /// In real time the world moves in steps of this, so that no age is known better.
  static constexpr Duration kMostLateness = std::chrono::milliseconds{5};

  RunWatch(std::int64_t run, std::string host, double rate)
      : run_(run), host_(std::move(host)), rate_(rate) {}

  /// A program of this run was started as this process; its former process is gone.
  void started(Instant now, const std::string& program, std::int64_t pid);
  /// It has ended, and is not expected to be heard.
  void ended(const std::string& program);
  /// It hangs, and is being ended.
  void given_up(Instant now, const std::string& program);
  /// A message on RUN/PRESENCE, who sent it (Message::sender; 0: not known), and whether that is an
  /// address of this host. The name of a host proves nothing.
  void heard(Instant now, const presence_t& presence, std::uint64_t sender = 0,
             bool from_this_host = true);
  /// A message on a channel on which only programs with a presence send.
  void sent(Instant now, const std::string& channel, std::uint64_t sender);
  /// A message on a channel of an external controller, which has no presence.
  void sent_by_controller(Instant now, const std::string& channel, std::uint64_t sender);
  /// The run is over: who has not said by now what it is was no program of it.
  void end(Instant now);
  /// A program's lateness so far, integrated over the time (RealTimeLoop::lateness_s2()), in µs·s.
  /// It begins at 0 again where a program was restarted.
  void late(const std::string& program, std::int64_t us_s);
  /// The finding on late loops of a run that has taken this time; "" if they were not late.
  std::string lateness(Duration run) const;
  /// Reports channels on which several programs send (SoleSender). Omitted if known unknown senders
  /// explain it.
  void several_senders(Instant now, const std::string& line);
  /// Regularly, several times a second.
  void update(Instant now);

  /// Own programs that hang now, and for how long (wall clock).
  std::vector<std::pair<std::string, Duration>> hung(Instant now) const;
  /// Whether this program has hung for longer than this.
  bool hangs(const std::string& program, Instant now, Duration for_so_long) const;

  /// All that makes the run invalid, in order; each once, with the time at which it was noticed.
  const std::vector<std::string>& findings() const { return findings_; }

 private:
  struct Own {
    std::int64_t pid = -1;
    std::uint16_t port = 0;  ///< port of its presence; its address may change with an interface
    Instant heard{};         ///< or the end of its time to start, less kSilence
    bool reported = false;
  };
  void heard_of_other_run(Instant now, const presence_t& presence);
  Duration silence(const Own& own, Instant now) const;
  void find(Instant now, const std::string& what);
  void judge_senders(Instant now, Instant since);
  void name(std::uint64_t sender);

  std::int64_t run_;
  std::string host_;
  double rate_;
  std::map<std::string, Own> own_;
  struct Former {
    std::string program;
    std::int64_t pid;
    std::uint16_t port;  ///< the same as in Own
  };
  std::vector<Former> former_;  ///< processes of this run that have ended
  std::vector<std::int64_t> other_runs_;
  struct Unnamed {
    std::string channel;
    Instant since;
  };
  struct Late {
    std::int64_t before_us_s = 0, newest_us_s = 0;
  };
  std::map<std::string, Late> late_;
  std::map<std::uint64_t, Unnamed> unnamed_;  ///< senders that have no presence yet
  std::set<std::uint64_t> named_;
  std::map<std::string, std::uint64_t> controllers_;  ///< who sent first on each of their channels
  bool has_unknown_senders_ = false;
  std::vector<std::string> known_;  ///< found, without their times
  std::vector<std::string> findings_;
  std::optional<Instant> updated_;
};

/// "tether-sim of AGV, process 4711 on host floor3".
std::string describe(const presence_t& presence);

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
