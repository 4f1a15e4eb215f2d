#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "autonomy/node/autonomy_node.hpp"
#include "common/base/errors.hpp"
#include "common/bus/in_process_bus.hpp"
#include "common/fleet/fleet.hpp"
#include "common/loop/node_group.hpp"
#include "common/loop/virtual_loop.hpp"
#include "common/onboard/onboard_settings.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/laws/law.hpp"
#include "controller/node/controller_node.hpp"
#include "localiser/node/localiser_node.hpp"
#include "netem/relay/netem_node.hpp"
#include "sim/node/sim_fleet.hpp"
#include "tools/loop/can_loop.hpp"

namespace tether {

/// The whole loop in one process, one thread and virtual time: what `tether run` runs; of a fleet,
/// all its vehicles' loops. Instances share nothing, so any number may run in as many threads.
class ClosedLoop {
 public:
  /// Throws UsageError for a scenario whose controller is somebody else's program.
  /// `law`: of a vehicle that is alone, in place of the scenario's.
  explicit ClosedLoop(const Scenario& scenario, std::unique_ptr<Law> law = nullptr)
      : scenario_(checked(scenario)),
        members_(fleet_members(scenario)),
        loop_(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
        bus_(loop_),
        sim_(members_, loop_, bus_),
        netem_(relays_of(members_, loop_, bus_, bus_)),
        controllers_(law ? controller_with(std::move(law))
                         : group_of<ControllerNode>(members_, loop_, bus_)) {
    if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
      can_ = std::make_unique<CanLoop>(scenario, loop_, bus_);
    }
    localisers_ = group_of<LocaliserNode>(members_with(has_localiser, members_), loop_, bus_);
    autonomies_ = group_of<AutonomyNode>(members_with(has_autonomy, members_), loop_, bus_);
  }

  /// For observers, which subscribe before the run.
  Bus& bus() { return bus_; }
  EventLoop& loop() { return loop_; }
  /// The scenario of each vehicle.
  const std::vector<Scenario>& members() const { return members_; }

  /// Runs to the scenario's end; the nodes' final reports included.
  void run() {
    run_until(kStart + from_seconds(scenario_.get<RunSettings>().duration_s));
    finish();
  }

  /// Runs a part, for callers that show progress; finish() after the last.
  void run_until(Instant end) { loop_.run_until(end); }
  void finish() {
    sim_.finish();
    netem_->finish();
    controllers_->finish();
    if (can_) can_->finish();
    localisers_->finish();
    autonomies_->finish();
    loop_.run_until(loop_.now());  // delivers the final reports
  }

  /// Of the i-th vehicle.
  SimNode& sim(std::size_t i = 0) { return sim_[i]; }
  const SimNode& sim(std::size_t i = 0) const { return sim_[i]; }
  const NetemNode& netem(std::size_t i = 0) const { return (*netem_)[i]; }
  NetemNode& netem(std::size_t i = 0) { return (*netem_)[i]; }
  ControllerNode& controller(std::size_t i = 0) { return (*controllers_)[i]; }
  /// Null with a direct drivetrain.
  CanLoop* can() { return can_.get(); }

 private:
  static const Scenario& checked(const Scenario& scenario) {
    if (scenario.get<ControllerSettings>().is_external()) {
      throw UsageError(
          "controller.external: this needs a controller of its own; tether run and tether live "
          "wait for another, and tether run and tether sweep start controller.command");
    }
    return scenario;
  }

  std::unique_ptr<NodeGroup<ControllerNode>> controller_with(std::unique_ptr<Law> law) {
    auto one = std::make_unique<NodeGroup<ControllerNode>>();
    one->add(std::make_unique<ControllerNode>(members_.front(), loop_, bus_, std::nullopt,
                                              std::move(law)));
    return one;
  }

  Scenario scenario_;
  std::vector<Scenario> members_;
  VirtualLoop loop_;
  InProcessBus bus_;
  SimFleet sim_;
  std::unique_ptr<NodeGroup<NetemNode>> netem_;
  std::unique_ptr<NodeGroup<ControllerNode>> controllers_;
  std::unique_ptr<CanLoop> can_;  ///< of a vehicle that is alone
  std::unique_ptr<NodeGroup<LocaliserNode>> localisers_;
  std::unique_ptr<NodeGroup<AutonomyNode>> autonomies_;
};

}  // namespace tether
