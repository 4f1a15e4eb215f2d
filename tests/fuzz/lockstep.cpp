#include <cstdint>
#include <map>
#include <string>
#include <tether/all_messages.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "common/lcm/lockstep_bus.hpp"
#include "common/lcm/lockstep_member.hpp"
#include "common/lcm/message_digest.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/fuzz/script.hpp"
#include "tests/support/virtual_world.hpp"
#include "tools/nodes/time_manager.hpp"

namespace tether::fuzzing {
namespace {

using tether::test::VirtualWorld;

constexpr std::int64_t kSession = 7;
const std::vector<std::string> kWords{"netem", "sim", "controller", "SIM/POSE", "NET/POSE", ".*"};

/// A node that says a twist each time it hears one, and every 10 ms.
class Parrot final : public Node {
 public:
  Parrot(EventLoop& loop, Bus& bus) : bus_(bus) {
    bus.subscribe("SIM/POSE", 1, [this](const Message&) { say(); });
    loop.every(kStart, std::chrono::milliseconds{10}, Priority::node, [this](Instant) { say(); });
  }
  void finish() override { say(); }

 private:
  void say() { publish(bus_, "NET/POSE", twist_t{}); }

  Bus& bus_;
};

/// By node; those that a welcome of play() hands out are zeros.
using Keys = std::map<std::string, DigestKey>;

/// One message that looks like one of this run.
template <class LcmType>
void say(Script& script, VirtualWorld& world, Keys& keys, const std::string& channel) {
  auto message = filled<LcmType>(script, kWords);
  if (script.byte() % 8 != 0) message.session = kSession;
  if constexpr (requires { message.mac; }) {
    if (script.byte() % 8 != 0) message.mac = mac_of(message, keys[message.node]);
  }
  if constexpr (requires { message.node_key; }) {
    if (script.byte() % 8 != 0) message.run_key = message.node_key = to_hex(DigestKey{});
  }
  publish(world.bus, channel, message);
}

void play(Script& script, VirtualWorld& world, Keys& keys) {
  for (int i = 0; i < 200 && !script.ended(); ++i) {
    switch (script.choice(8)) {
      case 0:
        say<time_welcome_t>(script, world, keys, kTimeWelcome);
        break;
      case 1:
        say<time_grant_t>(script, world, keys, kTimeGrant);
        break;
      case 2:
        say<time_resend_t>(script, world, keys, kTimeResend);
        break;
      case 3:
        say<time_join_t>(script, world, keys, kTimeJoin);
        break;
      case 4:
        say<time_request_t>(script, world, keys, kTimeRequest);
        break;
      case 5:
        world.bus.publish(kWords[script.choice(kWords.size())], script.take_some());
        break;
      default:
        world.loop.run_until(world.loop.now() + std::chrono::milliseconds{script.byte()});
    }
  }
  world.loop.run_until(world.loop.now() + std::chrono::seconds{60});
}

void try_member(Script& script) {
  VirtualWorld world;
  LockstepMember member({.session = kSession, .instance = 1, .name = "netem", .start = kStart},
                        world.loop, world.bus);
  Parrot parrot(member.loop(), member.bus());
  Instant last_asked{};
  world.bus.subscribe(kTimeJoin, 1, [&](const Message&) { last_asked = world.loop.now(); });
  member.join(parrot);
  Keys keys;
  play(script, world, keys);
  const bool asks = world.loop.now() - last_asked < std::chrono::seconds{1};
  must(asks || member.has_left() || !member.error().empty(),
       "a node that has lost its coordinator gives up");
}

void try_coordinator(Script& script) {
  VirtualWorld world;
  TimeManager::Config config;
  config.session = kSession;
  config.nodes = {"sim", "netem"};
  config.end = kStart + std::chrono::seconds{1};
  Instant last = Instant::min();
  TimeManager manager(config, world.loop, world.bus, [&](Instant when, const Message&) {
    must(when >= last, "a run is recorded in order");
    last = when;
  });
  Keys keys;
  std::int64_t undecodable = 0;
  subscribe<time_welcome_t>(world.bus, kTimeWelcome, kDeepQueue, undecodable,
                            [&keys](const time_welcome_t& welcome) {
                              const auto key = key_of_hex(welcome.node_key);
                              if (key) keys[welcome.node] = *key;
                            });
  play(script, world, keys);
  must(manager.done() || !manager.error().empty(), "a coordinator without nodes gives up");
}

}  // namespace

/// A script of messages to a node in lockstep, or to the coordinator.
void try_input(std::span<const std::uint8_t> input) {
  Script script(input);
  if (script.byte() % 2 == 0) {
    try_member(script);
  } else {
    try_coordinator(script);
  }
}

}  // namespace tether::fuzzing
