#include "common/node_main.hpp"
#include "controller/controller_node.hpp"

// CTRL/POSE ──▶ law ──▶ CTRL/CMD_VEL, CTRL/REPORT
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-controller",
                    .description = "The remote controller: poses in, velocity commands out",
                    .make = [](const NodeContext& c) {
                      return std::make_unique<ControllerNode>(c.scenario, c.loop, c.bus);
                    }});
}
