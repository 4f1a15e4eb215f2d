#include "common/program/node_main.hpp"
#include "tools/nodes/can_loop.hpp"

namespace tether {
namespace {

struct Drivetrain final : Node {
  explicit Drivetrain(const NodeContext& c) : can(c.scenario, c.loop, c.bus) {}
  void finish() override { can.finish(); }
  CanLoop can;
};

}  // namespace
}  // namespace tether

// AGV/CMD_VEL ──▶ bridge ⇄ CAN bus in memory ⇄ emulated drives ──▶ SIM/WHEEL_TARGETS
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-can",
                    .description = "CAN bridge and emulated drives on a CAN bus in memory: the "
                                   "drivetrain of a run in simulated time",
                    .examples = {"tether run --processes scenarios/hil_vcan.toml   # starts it"},
                    .lockstep_name = "can",
                    .make = [](const NodeContext& c) { return std::make_unique<Drivetrain>(c); }});
}
