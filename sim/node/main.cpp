#include "common/fleet/fleet.hpp"
#include "common/program/node_main.hpp"
#include "sim/node/sim_node.hpp"

// AGV/CMD_VEL ──▶ actuator ──▶ vehicle ──▶ sensor ──▶ AGV/POSE    (truth: SIM/TRUTH, SIM/CLOCK)
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(
      argc, argv,
      {.name = "tether-sim",
       .description = "The vehicle side of the loop: simulated vehicle, pose sensor, actuator",
       .examples = {"tether-sim scenarios/paper.toml   # the others start before it: tether-netem, "
                    "tether-controller"},
       .owns_clock = true,
       .lockstep_name = "sim",
       .make = [](const NodeContext& c) {
         return std::make_unique<SimFleet>(fleet_members(c.scenario), c.loop, c.bus);
       }});
}
