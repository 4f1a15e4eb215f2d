#include <sstream>

#include "common/scenario/run_settings.hpp"
#include "netem/relay/live_settings.hpp"
#include "netem/relay/netem_node.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether::fuzzing {

/// Each line is a request to the relay, while it relays: it answers, and goes on relaying.
void try_input(std::span<const std::uint8_t> input) {
  static const Scenario scenario;
  test::VirtualWorld world;
  const NetemNode relay(scenario, world.loop, world.bus, world.bus);
  std::vector<test::Seen<channel_setting_result_t>> answers;
  world.collect("NET/SETTINGS", answers);

  std::istringstream in(text_of(input));
  std::string line;
  int requests = 0;
  while (requests < 5 && std::getline(in, line)) {
    line.resize(std::min(line.size(), line.find('\0')));  // LCM's texts end there
    publish(world.bus, "NET/SET", setting_request(to_utime(world.loop.now()), ++requests, {line}));
    publish(world.bus, "AGV/POSE", test::pose(world.loop.now(), requests));
    world.loop.run_until(world.loop.now() + std::chrono::milliseconds{100});
  }
  must(std::ssize(answers) == requests, "each request is answered");
}

}  // namespace tether::fuzzing
