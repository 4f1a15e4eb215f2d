#include "common/ros2/ros2_messages.hpp"
#include "doors/ros2/cdr_reader.hpp"
#include "doors/ros2/command_gate.hpp"
#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

void try_input(std::span<const std::uint8_t> input) {
  const std::string cdr = text_of(input);
  CommandGate gate({});
  for (const auto& command : {read_twist(cdr), read_twist_stamped(cdr)}) {
    const auto taken = gate.take(kStart, 1, command);
    if (!taken) continue;
    must(is_usable(*taken), "a twist that goes on is finite");
    must(read_twist(twist_cdr(*taken))->twist.v_mps == taken->v_mps, "it survives a round trip");
  }
}

}  // namespace tether::fuzzing
