#include "common/fleet/fleet.hpp"
#include "common/node/node.hpp"
#include "common/program/node_main.hpp"
#include "onboard/autonomy/autonomy_node.hpp"

// AGV/SCAN, AGV/POSE, AGV/CMD_VEL ──▶ who drives? ──▶ AGV/DRIVE, AGV/AUTONOMY
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(
      argc, argv,
      {.name = "tether-autonomy",
       .description = "Autonomous driver of a vehicle, which can ask for a remote driver",
       .examples = {"tether-autonomy scenarios/factory_blocked.toml   # beside the "
                    "other nodes; they all together: tether live"},
       .lockstep_name = "autonomy",
       .make = [](const NodeContext& c) {
         return group_of<AutonomyNode>(members_with(has_autonomy, fleet_members(c.scenario)),
                                       c.loop, c.bus);
       }});
}
