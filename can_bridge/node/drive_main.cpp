#include "can_bridge/node/can_drive_node.hpp"
#include "can_bridge/node/can_node.hpp"

// CAN ⇄ emulated drives ──▶ SIM/WHEEL_TARGETS, and encoders from SIM/WHEELS
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-can-drive",
                    .description = "Emulated drives on a CAN bus, for the simulated wheels",
                    .examples = {"tether-can-drive scenarios/hil_vcan.toml   # on vcan0, beside "
                                 "tether-can-bridge and tether-sim"},
                    .make = [](const NodeContext& c) {
                      return std::make_unique<OnSocketCan<CanDriveNode>>(c);
                    }});
}
