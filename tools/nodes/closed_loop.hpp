#pragma once

#include <cstddef>
#include <memory>
#include <vector>

#include "common/node/in_process_bus.hpp"
#include "common/node/virtual_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "controller/laws/law.hpp"

namespace tether {

class AutonomyNode;
class CanLoop;
class ControllerNode;
class LocaliserNode;
class NetemNode;
class SimFleet;
class SimNode;
template <class T>
class NodeGroup;

/// The whole loop in one process, one thread and virtual time: what `tether run` runs; of a fleet,
/// all its vehicles' loops. Instances share nothing, so any number may run in as many threads.
class ClosedLoop {
 public:
  /// Throws UsageError for a scenario whose controller is an external program.
  /// `law`: of a vehicle that is alone, in place of the scenario's.
  explicit ClosedLoop(const Scenario& scenario, std::unique_ptr<Law> law = nullptr);
  ~ClosedLoop();
  ClosedLoop(const ClosedLoop&) = delete;
  ClosedLoop& operator=(const ClosedLoop&) = delete;

  /// For observers, which subscribe before the run.
  Bus& bus() { return bus_; }
  EventLoop& loop() { return loop_; }
  /// The scenario of each vehicle.
  const std::vector<Scenario>& members() const { return members_; }

  /// Runs to the scenario's end; the nodes' final reports included.
  void run();

  /// Runs a part, for callers that show progress; finish() after the last.
  void run_until(Instant end) { loop_.run_until(end); }
  void finish();

  /// Simulator of the i-th vehicle.
  SimNode& sim(std::size_t i = 0);
  const SimNode& sim(std::size_t i = 0) const;
  const NetemNode& netem(std::size_t i = 0) const;
  NetemNode& netem(std::size_t i = 0);
  ControllerNode& controller(std::size_t i = 0);
  /// Null with a direct drivetrain.
  CanLoop* can() { return can_.get(); }

 private:
  Scenario scenario_;
  std::vector<Scenario> members_;
  VirtualLoop loop_;
  InProcessBus bus_;
  std::unique_ptr<SimFleet> sim_;
  std::unique_ptr<NodeGroup<NetemNode>> netem_;
  std::unique_ptr<NodeGroup<ControllerNode>> controllers_;
  std::unique_ptr<CanLoop> can_;  ///< only for a single vehicle
  std::unique_ptr<NodeGroup<LocaliserNode>> localisers_;
  std::unique_ptr<NodeGroup<AutonomyNode>> autonomies_;
};

}  // namespace tether
