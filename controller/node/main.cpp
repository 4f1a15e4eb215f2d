#include <chrono>
#include <optional>

#include "common/fleet/fleet.hpp"
#include "common/node/node.hpp"
#include "common/program/node_main.hpp"
#include "controller/node/controller_node.hpp"

namespace {

/// Another number at each start of this program; in simulated time always the same.
std::optional<std::int64_t> session_of_this_start(const tether::EventLoop& loop) {
  if (loop.rate() == 0.0) return std::nullopt;
  using std::chrono::microseconds;
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<microseconds>(since_epoch).count();
}

}  // namespace

// CTRL/POSE ──▶ law ──▶ CTRL/CMD_VEL or CTRL/PLAN, CTRL/REPORT
int main(int argc, char** argv) {
  using namespace tether;
  return node_main(argc, argv,
                   {.name = "tether-controller",
                    .description = "The remote controller: poses in, velocity commands out",
                    .examples = {"tether-controller scenarios/paper.toml --set "
                                 "controller.law=tracking   # follows SIM/CLOCK"},
                    .lockstep_name = "controller",
                    .make = [](const NodeContext& c) {
                      const auto session = session_of_this_start(c.loop);
                      return group_of<ControllerNode>(fleet_members(c.scenario), c.loop, c.bus,
                                                      session);
                    }});
}
