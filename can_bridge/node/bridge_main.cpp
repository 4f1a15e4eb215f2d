#include "can_bridge/commission/guard.hpp"
#include "can_bridge/drivetrain/state_folder.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_node.hpp"
#include "common/base/input_file.hpp"

static_assert(tether::SafetyCore::kLongestLeave < tether::kWindDownLimit);

namespace {

/// Real drives need a record; emulated ones are compared with one that is named.
void compare_with_record(tether::OnSocketCan<tether::CanBridgeNode>& bridge,
                         const tether::Scenario& scenario) {
  using namespace tether;
  const auto& can = scenario.get<CanSettings>();
  const auto& vehicle = scenario.get<VehicleSettings>();
  const auto* const drives = std::get_if<Cia402Config>(&bridge.config());
  if (drives == nullptr || (can.emulate_drives && can.commission_record.empty())) return;
  const std::string file = can.commission_record.empty()
                               ? default_commission_record(vehicle.name, can.interface).string()
                               : can.commission_record;
  std::optional<CommissionRecord> record;
  std::string why;
  try {
    record = parse_record(read_input(file, "the record of commissioning", kMostTomlBytes), file);
  } catch (const UsageError& error) {
    why = error.what();
  }
  bridge.node().use_commission_guard({*drives, vehicle.wheel_radius_m, std::move(record), why});
}

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
  compare_with_record(*bridge, c.scenario);
  return bridge;
}

}  // namespace

// AGV/CMD_VEL ──▶ freshness, limits ──▶ drive profile ──▶ CAN ──▶ CAN/STATE, WHEELS, ODOMETRY
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(
      argc, argv,
      {.name = "tether-can-bridge",
       .description = "CAN bridge: turns commands into setpoints of the vehicle's drives",
       .examples = {"tether-can-bridge my_agv.toml --start-utime $(date +%s%6N) --lock-memory"},
       .make = make_bridge});
}
