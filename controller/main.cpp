#include <chrono>

#include "common/node_main.hpp"
#include "controller/controller_node.hpp"

namespace {

/// Another number at each start of this program.
std::int64_t session_of_this_start() {
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
                    .make = [](const NodeContext& c) {
                      return std::make_unique<ControllerNode>(c.scenario, c.loop, c.bus,
                                                              session_of_this_start());
                    }});
}
