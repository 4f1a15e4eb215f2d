#include "common/fleet/fleet.hpp"
#include "common/node/node.hpp"
#include "common/program/node_main.hpp"
#include "onboard/localiser/localiser_node.hpp"

// AGV/SCAN, AGV/ODOMETRY ──▶ map ──▶ AGV/POSE; or at the edge, CTRL/SCAN_PART … ──▶ CTRL/POSE
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-localiser",
                    .description = "The localiser: scans and odometry in, poses out",
                    .examples = {"tether-localiser scenarios/factory.toml   # beside the other "
                                 "nodes; they all together: tether live"},
                    .lockstep_name = "localiser",
                    .make = [](const NodeContext& c) {
                      return group_of<LocaliserNode>(
                          members_with(has_localiser, fleet_members(c.scenario)), c.loop, c.bus);
                    }});
}
