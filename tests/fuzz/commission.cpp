#include "can_bridge/commission/commission.hpp"

#include <memory>

#include "can_bridge/commission/guard.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "can_bridge/safety/transmit_whitelist.hpp"
#include "tests/fuzz/can_script.hpp"

namespace tether::fuzzing {
namespace {

constexpr Duration kCycle = std::chrono::milliseconds{20};

/// Commissioning, or the guard of an armed bridge, at its plug, for so many steps at most.
template <class Master>
void run(CanWorld& world, InProcessCan::Port& port, Script& script, int steps, Master&& tick) {
  for (int i = 0; i < steps && !script.ended(); ++i) {
    if (script.choice(3) == 0) {
      for (int cycles = script.byte(); cycles > 0; --cycles) {
        std::vector<CanFrame> out;
        tick(out);
        for (const CanFrame& frame : out) port.send(frame);
        world.pass_time(kCycle);
      }
    } else {
      world.unknown_sender.send(next_frame(script));
    }
  }
}

}  // namespace

/// A script of CAN frames to `tether can commission` and to the guard that compares its record,
/// with the emulated drives on their bus or without. What is written down is read as it is written.
void try_input(std::span<const std::uint8_t> input) {
  static const Scenario scenario;
  Script script(input);
  const DrivetrainConfig& drivetrain = choose_drivetrain(script);
  const auto* config = std::get_if<Cia402Config>(&drivetrain);
  if (!config) return;
  const TransmitRules rules = transmit_rules(drivetrain);
  const VehicleConfig vehicle;

  CanWorld world;
  InProcessCan::Port& port = world.can.add_port();
  std::unique_ptr<CanDriveNode> drives;
  const std::size_t kind = script.choice(4);
  if (kind >= 1) {
    drives = std::make_unique<CanDriveNode>(scenario, drivetrain, world.loop, world.bus,
                                            world.can.add_port());
  }
  Commission commission(*config, vehicle, {.wheels_free = kind == 2, .cycle = kCycle},
                        world.loop.now());
  std::unique_ptr<CommissionGuard> guard;
  port.on_frame(commission.filters(), [&](const CanFrame& frame) {
    guard ? guard->on_frame(frame) : commission.on_frame(frame, world.loop.now());
  });
  run(world, port, script, 60, [&](std::vector<CanFrame>& out) {
    commission.tick(world.loop.now(), out);
    for (CanFrame frame : out) {
      TransmitWhitelist whitelist(rules);
      must(whitelist.pass(frame, commission.may_move()), "only what the rules allow is sent");
      must(whitelist.counters().zeroed == 0, "nothing moves unless it may");
    }
  });
  CommissionRecord record = commission.record();
  record.vehicle = record.interface = record.operator_name = record.date = "as people say";
  if (!record.results.empty() && !record.objects.empty()) {
    const std::string text = to_toml(record);
    must(to_toml(parse_record(text, "record.toml")) == text, "a record is read as it is written");
  }

  guard = std::make_unique<CommissionGuard>(*config, vehicle.wheel_radius_m, record, "");
  run(world, port, script, 10, [&](std::vector<CanFrame>& out) {
    guard->tick(world.loop.now(), DrivePhase::standby, out);
    must(commission.done() || !guard->refusal().empty(), "nothing is armed that was not tried");
  });
}

}  // namespace tether::fuzzing
