#pragma once

#include <optional>
#include <vector>

#include "common/bus/bus.hpp"
#include "common/loop/event_loop.hpp"
#include "common/loop/node.hpp"
#include "common/loop/node_group.hpp"
#include "common/scenario/scenario.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/node/traffic.hpp"

namespace tether {

/// The vehicle sides of all vehicles of a fleet, in one hall; of one vehicle, just its SimNode.
class SimFleet final : public Node {
 public:
  /// `members`: of fleet_members().
  SimFleet(const std::vector<Scenario>& members, EventLoop& loop, Bus& bus);

  void finish() override { nodes_.finish(); }

  std::size_t size() const { return nodes_.size(); }
  SimNode& operator[](std::size_t i) { return nodes_[i]; }
  const SimNode& operator[](std::size_t i) const { return nodes_[i]; }

 private:
  std::optional<Traffic> traffic_;
  NodeGroup<SimNode> nodes_;
};

}  // namespace tether
