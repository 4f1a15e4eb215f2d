#include "common/node_main.hpp"
#include "netem/netem_node.hpp"

// AGV/POSE ──▶ uplink ──▶ CTRL/POSE,  CTRL/CMD_VEL ──▶ downlink ──▶ AGV/CMD_VEL,  reports: NET/…
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-netem",
                    .description = "The network between vehicle and controller: loss and delay",
                    .joins_two_networks = true,
                    .make = [](const NodeContext& c) {
                      return std::make_unique<NetemNode>(c.scenario, c.loop, c.bus, c.control_bus);
                    }});
}
