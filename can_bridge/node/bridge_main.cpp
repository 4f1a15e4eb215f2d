#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_node.hpp"

static_assert(tether::SafetyCore::kLongestLeave < tether::kWindDownLimit);

// AGV/CMD_VEL ──▶ freshness, limits ──▶ drive profile ──▶ CAN ──▶ CAN/STATE, WHEELS, ODOMETRY
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-can-bridge",
                    .description = "The vehicle's drivetrain on CAN: commands in, drives out",
                    .make = [](const NodeContext& c) {
                      return std::make_unique<OnSocketCan<CanBridgeNode>>(c);
                    }});
}
