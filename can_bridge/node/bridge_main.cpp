#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_node.hpp"

static_assert(tether::SafetyCore::kLongestLeave < tether::kWindDownLimit);

namespace {

std::unique_ptr<tether::Node> make_bridge(const tether::NodeContext& c) {
  using namespace tether;
  auto bridge = std::make_unique<OnSocketCan<CanBridgeNode>>(c);
  const auto& can = c.scenario.get<CanSettings>();
  const auto& vehicle = c.scenario.get<VehicleSettings>();
  if (!can.estop_file.empty()) {
    bridge->node().use_estop_file(EstopFile(can.estop_file));
  } else if (!can.emulate_drives) {
    bridge->node().use_estop_file(EstopFile(default_estop_file(vehicle.name, can.interface)));
  }
  return bridge;
}

}  // namespace

// AGV/CMD_VEL ──▶ freshness, limits ──▶ drive profile ──▶ CAN ──▶ CAN/STATE, WHEELS, ODOMETRY
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(
      argc, argv,
      {.name = "tether-can-bridge",
       .description = "The vehicle's drivetrain on CAN: commands in, drives out",
       .examples = {"tether-can-bridge my_agv.toml --start-utime $(date +%s%6N) --lock-memory"},
       .make = make_bridge});
}
