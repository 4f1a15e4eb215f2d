#include <memory>
#include <tether/drive_request_t.hpp>

#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "tests/fuzz/can_script.hpp"

namespace tether::fuzzing {
namespace {

/// The bridge's plug, and what goes out by it.
class WatchedPort final : public CanPort {
 public:
  WatchedPort(CanPort& port, const DrivetrainConfig& config)
      : port_(port), rules_(transmit_rules(config)) {}

  bool send(const CanFrame& frame) override {
    TransmitWhitelist whitelist(rules_);
    CanFrame copy = frame;
    must(whitelist.pass(copy, false), "the bridge sends nothing but what the rules allow");
    moves = moves || whitelist.counters().zeroed > 0;
    return port_.send(frame);
  }
  void on_frame(std::vector<CanFilter> filters, FrameHandler handler) override {
    port_.on_frame(std::move(filters), std::move(handler));
  }
  void on_state(StateHandler handler) override { port_.on_state(std::move(handler)); }
  CanState state() const override { return port_.state(); }
  bool restart(std::string& why) override { return port_.restart(why); }
  void list(CounterList& out) const override { port_.list(out); }

  bool moves = false;  ///< a speed other than zero was sent

 private:
  CanPort& port_;
  TransmitRules rules_;
};

Scenario scenario_of(bool with_plans) {
  Scenario scenario;
  scenario.get<CanSettings>().cycle_ms = 20.0;
  if (with_plans) scenario.get<ActuatorSettings>().policy = "horizon";
  return scenario;
}

/// The script's next command.
void steer(Script& script, CanWorld& world) {
  const double v_mps = script.number<std::int8_t>() * 0.02;
  for (int i = 0; i < 10; ++i) {
    world.steer(v_mps);
    world.pass_time(std::chrono::milliseconds{20});
  }
}

void step(Script& script, CanWorld& world, InProcessCan::Port& port) {
  switch (script.choice(9)) {
    case 0:
      return world.pass_time(std::chrono::milliseconds{4 * script.byte()});
    case 1:
      return steer(script, world);
    case 2:
      return world.say<drive_request_t>(script, "CAN/REQUEST");
    case 3:
      return world.say<twist_t>(script, "AGV/CMD_VEL");
    case 4:
      return world.say<plan_t>(script, "AGV/PLAN");
    case 5:
      return world.say<plan_t>(script, "AGV/PRELOAD");
    case 6:
      return world.say<drive_fault_t>(script, "CAN/INJECT");
    case 7:
      return port.set_state(static_cast<CanState>(script.choice(6)));
    default:
      world.unknown_sender.send(next_frame(script));
  }
}

}  // namespace

/// A script of CAN frames and messages to the bridge, with the emulated drives on its bus or
/// without. Nothing gets a command to move before the first ARM, nor, by twists, long after the
/// last one.
void try_input(std::span<const std::uint8_t> input) {
  static const Scenario twists = scenario_of(false), plans = scenario_of(true);
  Script script(input);
  const DrivetrainConfig& config = choose_drivetrain(script);
  const std::size_t kind = script.choice(4);
  const bool takes_plans = kind == 1 || kind == 3, has_drives = kind >= 2;
  const Scenario& scenario = takes_plans ? plans : twists;

  CanWorld world;
  InProcessCan::Port& port = world.can.add_port();
  WatchedPort watched(port, config);
  const CanBridgeNode bridge(scenario, config, world.loop, world.bus, watched);
  std::unique_ptr<CanDriveNode> drives;
  if (has_drives) {
    drives = std::make_unique<CanDriveNode>(scenario, config, world.loop, world.bus,
                                            world.can.add_port());
  }
  bool armed = false;
  subscribe<drive_request_t>(world.bus, "CAN/REQUEST", 1, world.undecodable,
                             [&](const auto& m) { armed |= m.request == drive_request_t::ARM; });
  for (int i = 0; i < 60 && !script.ended(); ++i) {
    step(script, world, port);
    must(armed || !watched.moves, "no command to move before the first ARM");
  }
  if (!watched.moves || takes_plans) return;
  world.pass_time(std::chrono::seconds{6});
  watched.moves = false;
  world.pass_time(std::chrono::seconds{1});
  must(!watched.moves, "no command to move long after the last twist");
}

}  // namespace tether::fuzzing
