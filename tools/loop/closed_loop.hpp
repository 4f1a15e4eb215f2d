#pragma once

#include <memory>

#include "common/base/errors.hpp"
#include "common/bus/in_process_bus.hpp"
#include "common/loop/virtual_loop.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/node/controller_node.hpp"
#include "netem/relay/netem_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tools/loop/can_loop.hpp"

namespace tether {

/// The whole loop in one process, one thread and virtual time: what `tether run` runs. Instances
/// share nothing, so any number may run in as many threads.
class ClosedLoop {
 public:
  /// Throws UsageError for a scenario whose controller is somebody else's program.
  explicit ClosedLoop(const Scenario& scenario)
      : scenario_(checked(scenario)),
        loop_(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
        bus_(loop_),
        sim_(scenario, loop_, bus_),
        netem_(scenario, loop_, bus_, bus_),
        controller_(scenario, loop_, bus_) {
    if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
      can_ = std::make_unique<CanLoop>(scenario, loop_, bus_);
    }
  }

  /// For observers, which subscribe before the run.
  Bus& bus() { return bus_; }
  EventLoop& loop() { return loop_; }

  /// Runs to the scenario's end; the nodes' final reports included.
  void run() {
    run_until(kStart + from_seconds(scenario_.get<RunSettings>().duration_s));
    finish();
  }

  /// Runs a part, for callers that show progress; finish() after the last.
  void run_until(Instant end) { loop_.run_until(end); }
  void finish() {
    for (Node* node : {static_cast<Node*>(&sim_), static_cast<Node*>(&netem_),
                       static_cast<Node*>(&controller_)}) {
      node->finish();
    }
    if (can_) can_->finish();
    loop_.run_until(loop_.now());  // delivers the final reports
  }

  SimNode& sim() { return sim_; }
  const SimNode& sim() const { return sim_; }
  const NetemNode& netem() const { return netem_; }
  NetemNode& netem() { return netem_; }
  /// Null with a direct drivetrain.
  CanLoop* can() { return can_.get(); }

 private:
  static const Scenario& checked(const Scenario& scenario) {
    if (scenario.get<ControllerSettings>().external) {
      throw UsageError(
          "controller.external: a run in one process has its own controller; tether run "
          "--processes and tether live wait for another");
    }
    return scenario;
  }

  Scenario scenario_;
  VirtualLoop loop_;
  InProcessBus bus_;
  SimNode sim_;
  NetemNode netem_;
  ControllerNode controller_;
  std::unique_ptr<CanLoop> can_;
};

}  // namespace tether
