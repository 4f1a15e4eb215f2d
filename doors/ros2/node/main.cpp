#include "common/program/node_main.hpp"
#include "doors/ros2/node/ros2_node.hpp"

// CTRL/POSE, CTRL/ODOMETRY, CTRL/SCAN_PART ──▶ ROS 2; /cmd_vel ──▶ CTRL/CMD_VEL
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-ros2",
                    .description = "ROS 2 nodes as the remote controller: poses out, /cmd_vel in",
                    .examples = {"tether-ros2 scenarios/paper.toml --set controller.ros2=true   "
                                 "# follows SIM/CLOCK"},
                    .lockstep_name = "controller",
                    .make = [](const NodeContext& c) {
                      return std::make_unique<Ros2Node>(c.scenario, c.loop, c.bus);
                    }});
}
