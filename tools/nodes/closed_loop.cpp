#include "tools/nodes/closed_loop.hpp"

#include <optional>
#include <utility>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/node.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/onboard_settings.hpp"
#include "controller/laws/controller_settings.hpp"
#include "controller/node/controller_node.hpp"
#include "netem/relay/netem_node.hpp"
#include "onboard/autonomy/autonomy_node.hpp"
#include "onboard/localiser/localiser_node.hpp"
#include "sim/node/sim_node.hpp"
#include "tools/nodes/can_loop.hpp"

namespace tether {
namespace {

const Scenario& checked(const Scenario& scenario) {
  if (scenario.get<ControllerSettings>().is_external()) {
    throw UsageError(
        "controller.external: this needs a controller of its own; tether run and tether live "
        "wait for another, and tether run and tether sweep start controller.command");
  }
  return scenario;
}

}  // namespace

ClosedLoop::ClosedLoop(const Scenario& scenario, std::unique_ptr<Law> law)
    : scenario_(checked(scenario)),
      members_(fleet_members(scenario)),
      loop_(kStart - from_seconds(scenario.get<RunSettings>().lead_s)),
      bus_(loop_),
      sim_(std::make_unique<SimFleet>(members_, loop_, bus_)),
      netem_(relays_of(members_, loop_, bus_, bus_)) {
  if (law) {
    controllers_ = std::make_unique<NodeGroup<ControllerNode>>();
    controllers_->add(std::make_unique<ControllerNode>(members_.front(), loop_, bus_, std::nullopt,
                                                       std::move(law)));
  } else {
    controllers_ = group_of<ControllerNode>(members_, loop_, bus_);
  }
  if (scenario.get<VehicleSettings>().drivetrain == VehicleSettings::Drivetrain::can) {
    can_ = std::make_unique<CanLoop>(scenario, loop_, bus_);
  }
  localisers_ = group_of<LocaliserNode>(members_with(has_localiser, members_), loop_, bus_);
  autonomies_ = group_of<AutonomyNode>(members_with(has_autonomy, members_), loop_, bus_);
}

ClosedLoop::~ClosedLoop() = default;

void ClosedLoop::run() {
  run_until(kStart + from_seconds(scenario_.get<RunSettings>().duration_s));
  finish();
}

void ClosedLoop::finish() {
  sim_->finish();
  netem_->finish();
  controllers_->finish();
  if (can_) can_->finish();
  localisers_->finish();
  autonomies_->finish();
  loop_.run_until(loop_.now());  // delivers the final reports
}

SimNode& ClosedLoop::sim(std::size_t i) { return (*sim_)[i]; }
const SimNode& ClosedLoop::sim(std::size_t i) const { return std::as_const(*sim_)[i]; }
const NetemNode& ClosedLoop::netem(std::size_t i) const { return std::as_const(*netem_)[i]; }
NetemNode& ClosedLoop::netem(std::size_t i) { return (*netem_)[i]; }
ControllerNode& ClosedLoop::controller(std::size_t i) { return (*controllers_)[i]; }

}  // namespace tether
