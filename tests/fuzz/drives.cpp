#include <cmath>
#include <tether/wheel_targets_t.hpp>

#include "can_bridge/node/can_drive_node.hpp"
#include "tests/fuzz/can_script.hpp"

namespace tether::fuzzing {

/// A script of CAN frames, faults and wheels to the emulated drives: they turn at finite speeds.
void try_input(std::span<const std::uint8_t> input) {
  static const Scenario scenario;
  Script script(input);
  CanWorld world;
  const CanDriveNode drives(scenario, choose_drivetrain(script), world.loop, world.bus,
                            world.can.add_port());
  subscribe<wheel_targets_t>(
      world.bus, "SIM/WHEEL_TARGETS", 1, world.undecodable, [](const wheel_targets_t& targets) {
        must(std::isfinite(targets.left_speed_radps) && std::isfinite(targets.right_speed_radps),
             "emulated drives turn at finite speeds");
      });
  for (int i = 0; i < 200 && !script.ended(); ++i) {
    switch (script.choice(8)) {
      case 0:
        world.pass_time(std::chrono::milliseconds{script.byte()});
        break;
      case 1:
        world.say<drive_fault_t>(script, "CAN/INJECT");
        break;
      case 2:
        world.say<wheel_states_t>(script, "SIM/WHEELS");
        break;
      default:
        world.unknown_sender.send(next_frame(script));
    }
  }
  world.pass_time(std::chrono::milliseconds{200});
}

}  // namespace tether::fuzzing
