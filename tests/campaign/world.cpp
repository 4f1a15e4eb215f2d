#include "tests/campaign/world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <tether/drive_fault_t.hpp>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/plan_in_force_t.hpp>
#include <tether/wheel_states_t.hpp>
#include <utility>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/in_process_can.hpp"
#include "can_bridge/emulated/node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "common/node/in_process_bus.hpp"
#include "common/node/message_io.hpp"
#include "common/node/virtual_loop.hpp"
#include "tests/campaign/process.hpp"
#include "tests/campaign/traffic.hpp"
#include "tests/campaign/unknown_sender.hpp"
#include "tests/campaign/witness.hpp"

namespace tether::campaign {
namespace {

/// A bridge as a process of its own.
struct Bridge {
  Bridge(const BridgeSettings& settings, const Setup& setup, EventLoop& world_loop, Bus& world_bus,
         InProcessCan::Port& world_port, const Bus::Handler& received,
         const CanPort::FrameHandler& sent)
      : loop(process, world_loop),
        bus(process, world_bus, received),
        interface(world_port),
        port(process, world_port, sent),
        node(settings, setup.drivetrain, loop, bus, port) {}

  Process process;
  ProcessLoop loop;
  ProcessBus bus;
  InProcessCan::Port& interface;
  ProcessPort port;
  CanBridgeNode node;
};

/// The vehicle's side: bridge, CAN bus, emulated drives; and all that may go wrong with it.
class World {
 public:
  World(const Setup& setup, const Trial& trial, bool notes)
      : trial_(trial),
        settings_(settings_of(setup, trial)),
        wheel_radius_m_(settings_.get<VehicleSettings>().wheel_radius_m),
        notes_(notes),
        bus_(loop_),
        can_(loop_, settings_.get<CanSettings>().bit_rate_bps),
        witness_(record_),
        drives_loop_(drives_process_, loop_),
        drives_(settings_, drivetrain_of(setup, trial), drives_loop_, bus_, can_.add_port()),
        received_([this](const Message& m) { on_message(m); }),
        sent_([this](const CanFrame& f) { on_sent(f); }),
        bridge_(settings_, setup, loop_, bus_, can_.add_port(), received_, sent_),
        next_bridge_(settings_, setup, loop_, bus_, can_.add_port(), received_, sent_),
        network_(trial, loop_, bus_),
        controller_(trial, "controller", loop_, network_, heard_),
        second_(trial, "second", loop_, network_, heard_),
        operator_(trial, loop_, bus_, heard_),
        unknown_sender_(trial, loop_, can_.add_port(), record_.foreign) {
    next_bridge_.process.set_alive(false);
    record_.limits = limits_of(settings_);
    record_.quiet = trial.quiet;
    record_.end = trial.end;
    can_.on_any_frame([this](const CanFrame& f) { on_frame(f); });
    listen();
    begin_actors();
    for (const Fault& fault : trial.faults) {
      loop_.at(fault.when, Priority::node, [this, fault](Instant) { begin(fault); });
      loop_.at(fault.until, Priority::node, [this, fault](Instant) { end(fault); });
    }
  }

  Record run() {
    loop_.run_until(trial_.end);
    return std::move(record_);
  }

 private:
  void listen();
  void begin_actors();
  void on_state(const drivetrain_state_t& m);
  void on_wheels(const wheel_states_t& m);
  void on_message(const Message& message);
  void on_sent(const CanFrame& frame);
  void watch_power(const CanFrame& frame);
  bool powers(std::size_t wheel) const;
  void on_frame(const CanFrame& frame);
  void begin(const Fault& fault);
  void begin_message_fault(const Fault& fault);
  void begin_request(const Fault& fault);
  void begin_vehicle_fault(const Fault& fault);
  void end(const Fault& fault);
  void set_bus(CanState state);
  void inject(const Fault& fault, std::int32_t kind, double value);
  void cut_short(const Fault& fault);
  void note(const std::string& text) {
    if (notes_) record_.notes.push_back(fmt::format("{:8.3f} {}", to_seconds(loop_.now()), text));
  }

  const Trial& trial_;
  BridgeSettings settings_;
  double wheel_radius_m_;
  bool notes_;
  Record record_;
  Heard heard_;
  std::string reason_;
  bool wheels_turn_ = false;
  VirtualLoop loop_;
  InProcessBus bus_;
  InProcessCan can_;
  Witness witness_;
  Process drives_process_;
  ProcessLoop drives_loop_;
  CanDriveNode drives_;
  Bus::Handler received_;
  CanPort::FrameHandler sent_;
  Bridge bridge_;
  Bridge next_bridge_;  ///< not yet alive
  bool killed_ = false;
  Network network_;
  Controller controller_;
  Controller second_;
  Operator operator_;
  UnknownSender unknown_sender_;
  std::int64_t injections_ = 0;
  std::int64_t undecodable_ = 0;
};

void World::listen() {
  subscribe<drivetrain_state_t>(bus_, "CAN/STATE", kDeepQueue, undecodable_,
                                [this](const drivetrain_state_t& m) { on_state(m); });
  subscribe<wheel_states_t>(bus_, "SIM/WHEELS", kDeepQueue, undecodable_,
                            [this](const wheel_states_t& m) { on_wheels(m); });
  if (!trial_.plans) return;
  subscribe<plan_in_force_t>(bus_, "CAN/PLAN", kDeepQueue, undecodable_,
                             [this](const plan_in_force_t& m) {
                               heard_.plan = {m.session, m.id};
                             });
}

void World::begin_actors() {
  const Duration period = from_seconds(trial_.period_s);
  loop_.every(kStart + period / 3, period, Priority::node, [this](Instant now) {
    if (now < trial_.quiet) controller_.step();
  });
  loop_.every(kStart + std::chrono::milliseconds{500}, std::chrono::milliseconds{20},
              Priority::node, [this](Instant now) {
                if (now < trial_.quiet) operator_.step();
              });
}

void World::on_state(const drivetrain_state_t& m) {
  const bool was_armed = heard_.state == drivetrain_state_t::ARMED;
  if (was_armed && m.state != drivetrain_state_t::ARMED) record_.stops.push_back(m.reason);
  if (was_armed) record_.armed_s += to_seconds(record_.limits.cycle);
  if (m.state != heard_.state || m.reason.substr(0, 12) != reason_.substr(0, 12)) {
    note(fmt::format("  {:9} {:5.2f} m/s {:5.2f} rad/s  {}", m.state_name, m.v_mps, m.omega_radps,
                     m.reason));
  }
  reason_ = m.reason;
  if (m.state != heard_.state) heard_.since = loop_.now();
  heard_.state = m.state;
  record_.states.push_back({loop_.now(), m.state, {m.v_mps, m.omega_radps}});
}

void World::on_wheels(const wheel_states_t& m) {
  const double left = m.left_speed_radps * wheel_radius_m_;
  const double right = m.right_speed_radps * wheel_radius_m_;
  record_.driven_m +=
      std::abs(left + right) / 2.0 * settings_.get<VehicleSettings>().coupling_ms * 1e-3;
  const bool turn = std::max(std::abs(left), std::abs(right)) >= 0.02;
  if (std::exchange(wheels_turn_, turn) != turn) {
    note(fmt::format("  wheels {}: {:.2f} m/s, {:.2f} m/s", turn ? "turn" : "stand", left, right));
  }
  record_.wheels.push_back({from_utime(m.utime), {left, right}, {powers(0), powers(1)}});
}

void World::on_message(const Message& message) {
  witness_.on_message(loop_.now(), message);
  if (message.channel == "CAN/REQUEST" && notes_) {
    constexpr const char* kNames[] = {"?", "ARM", "DISARM", "ESTOP", "RELEASE", "RESET"};
    const RequestSample& sample = record_.requests.back();
    note(fmt::format("{}{}", kNames[sample.request], sample.acts ? "" : " (old)"));
  }
}

bool World::powers(std::size_t wheel) const {
  const auto& drives = dynamic_cast<const EmulatedCia402&>(drives_.drives());
  return drives.nodes().at(wheel)->powers(wheel);
}

void World::watch_power(const CanFrame& frame) {
  for (std::size_t i = 0; i < 2 && !record_.wheels.empty(); ++i) {
    const auto node = static_cast<std::uint8_t>(i + 1);
    const double rim_mps = record_.wheels.back().rim_mps[i];
    if (frame.id == canopen::kNmt && (frame.data[1] == 0 || frame.data[1] == node)) {
      const auto command = static_cast<canopen::NmtCommand>(frame.data[0]);
      if (command == canopen::NmtCommand::reset_node ||
          command == canopen::NmtCommand::reset_communication) {
        record_.cuts.push_back({loop_.now(), i, rim_mps, true});
      }
      continue;
    }
    const bool by_pdo = frame.id == canopen::pdo_id(false, 1, node);
    const bool by_sdo = frame.id == canopen::kSdoRequest + node && frame.data[0] == 0x2B &&
                        frame.data[1] == 0x40 && frame.data[2] == 0x60;
    if (!by_pdo && !by_sdo) continue;
    const std::uint8_t word = frame.data[by_pdo ? 0 : 4];
    const bool disables = (word & 2) == 0 || (word & 0x0F) == 0x06;
    if (disables && powers(i)) record_.cuts.push_back({loop_.now(), i, rim_mps, false});
  }
}

void World::on_sent(const CanFrame& frame) {
  watch_power(frame);
  const bool setpoint =
      frame.id == canopen::pdo_id(false, 1, 1) || frame.id == canopen::pdo_id(false, 1, 2);
  if (!setpoint) return;
  const bool moves = canopen::read_integer(frame.data.data() + 2, 4, true) != 0;
  record_.setpoints.push_back({loop_.now(), moves});
}

void World::on_frame(const CanFrame& frame) {
  for (std::size_t i = 0; i < 2; ++i) {
    const auto node = static_cast<std::uint8_t>(i + 1);
    if (frame.id == canopen::pdo_id(false, 1, node)) record_.heard[i].push_back(loop_.now());
  }
}

void World::set_bus(CanState state) {
  bridge_.interface.set_state(state);
  next_bridge_.interface.set_state(state);
}

void World::begin(const Fault& fault) {
  if (fault.kind == FaultKind::bridge_restarted && killed_) return;  // once a run
  note(fmt::format("{} (until {:.3f}, share {:.2f}, node {})", row_of(fault.kind).name,
                   to_seconds(fault.until), fault.share, fault.node));
  record_.faults.push_back(fault);
  network_.begin(fault);
  begin_message_fault(fault);
  begin_request(fault);
  begin_vehicle_fault(fault);
  unknown_sender_.begin(fault);
}

void World::begin_message_fault(const Fault& fault) {
  using K = FaultKind;
  const auto again = [this, &fault](Duration period, const std::function<void()>& act) {
    for (Instant t = fault.when; t <= fault.until; t += period) {
      loop_.at(t, Priority::node, [act](Instant) { act(); });
    }
  };
  const auto forge = [this, &again](const Forgery& forgery) {
    again(std::chrono::milliseconds{30}, [this, forgery] { controller_.forge(forgery); });
  };
  const double share = fault.share;
  switch (fault.kind) {
    case K::replay:
      return again(std::chrono::milliseconds{20}, [this, share] { network_.replay(share); });
    case K::forged_session:
      return forge({.session = true});
    case K::forged_nan:
      return forge({.nan = true});
    case K::forged_huge:
      return forge({.huge = true});
    case K::forged_future:
      return forge({.future = true});
    case K::forged_number:
      return forge({.number = true});
    case K::second_sender:
      return again(from_seconds(trial_.period_s), [this] { second_.step(); });
    case K::controller_silent:
      controller_.silent = true;
      return;
    case K::controller_restarted:
      return controller_.restart();
    case K::frozen_pose:
      controller_.frozen = fault.when;
      return;
    default:
      return;
  }
}

void World::begin_request(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::arm:
      return operator_.request(drive_request_t::ARM);
    case FaultKind::disarm:
      return operator_.request(drive_request_t::DISARM);
    case FaultKind::estop:
      return operator_.request(drive_request_t::ESTOP);
    case FaultKind::release:
      return operator_.request(drive_request_t::ESTOP_RELEASE);
    case FaultKind::reset:
      return operator_.request(drive_request_t::RESET);
    case FaultKind::replayed_request:
      return operator_.replay(fault.share);
    case FaultKind::late_request:
      return operator_.request(1 + static_cast<std::int32_t>(5.0 * fault.share),
                               fault.until - fault.when);
    default:
      return;
  }
}

void World::begin_vehicle_fault(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::bridge_stalls:
      record_.stalls.push_back({fault.when, fault.until});
      return (killed_ ? next_bridge_ : bridge_).process.suspend();
    case FaultKind::bridge_restarted:
      killed_ = true;
      record_.stalls.push_back({fault.when, fault.until});
      return bridge_.process.set_alive(false);
    case FaultKind::drive_fault:
      return inject(fault, drive_fault_t::FAULT, 0.0);
    case FaultKind::drive_reboot:
      return inject(fault, drive_fault_t::REBOOT, 0.0);
    case FaultKind::drive_silent:
      return inject(fault, drive_fault_t::SILENCE, 0.0);
    case FaultKind::sdo_abort:
      return inject(fault, drive_fault_t::SDO_ABORT, 0.0);
    case FaultKind::encoder_freeze:
      return inject(fault, drive_fault_t::ENCODER_FREEZE, 0.0);
    case FaultKind::wheel_slip:
      return inject(fault, drive_fault_t::WHEEL_SLIP, fault.share);
    case FaultKind::pushed: {
      constexpr double kHardest_radps2 = 5.0;  // 2 m/s² at the rim
      return inject(fault, drive_fault_t::PUSH, kHardest_radps2 * (2.0 * fault.share - 1.0));
    }
    case FaultKind::weak_brake:
      return inject(fault, drive_fault_t::WEAK_BRAKE, fault.share);
    case FaultKind::bus_off:
      return set_bus(CanState::bus_off);
    case FaultKind::bus_stalled:
      return set_bus(CanState::stalled);
    case FaultKind::bus_down:
      return set_bus(CanState::down);
    case FaultKind::error_passive:
      return set_bus(CanState::error_passive);
    default:
      return;
  }
}

void World::end(const Fault& fault) {
  using K = FaultKind;
  network_.end(fault);
  switch (fault.kind) {
    case K::controller_silent:
      controller_.silent = false;
      return;
    case K::frozen_pose:
      controller_.frozen.reset();
      return;
    case K::bridge_stalls:
      bridge_.process.go_on();
      return next_bridge_.process.go_on();
    case K::bridge_restarted:
      if (!record_.restarts.empty()) return;
      record_.restarts.push_back(loop_.now());
      if (bridge_.node.estop_latched())
        next_bridge_.node.restore_estop("it was latched when the bridge ended last");
      return next_bridge_.process.set_alive(true);
    case K::drive_silent:
    case K::sdo_abort:
    case K::encoder_freeze:
    case K::wheel_slip:
    case K::pushed:
    case K::weak_brake:
      cut_short(fault);
      return inject(fault, drive_fault_t::NONE, 0.0);
    case K::bus_off:
    case K::bus_stalled:
    case K::bus_down:
    case K::error_passive:
      return set_bus(CanState::up);
    default:
      return;
  }
}

/// The end of one injected fault of a drive ends its others, too.
void World::cut_short(const Fault& fault) {
  for (Fault& other : record_.faults) {
    const bool injected =
        other.kind == FaultKind::drive_silent || other.kind == FaultKind::sdo_abort ||
        other.kind == FaultKind::encoder_freeze || other.kind == FaultKind::wheel_slip ||
        other.kind == FaultKind::pushed || other.kind == FaultKind::weak_brake;
    if (injected && other.node == fault.node) other.until = std::min(other.until, loop_.now());
  }
}

void World::inject(const Fault& fault, std::int32_t kind, double value) {
  drive_fault_t m{};
  m.utime = to_utime(loop_.now());
  m.seq = injections_++;
  m.node = fault.node;
  m.kind = kind;
  m.value = value;
  publish(bus_, "CAN/INJECT", m);
}

}  // namespace

Record run_trial(const Setup& setup, const Trial& trial, bool notes) {
  return World(setup, trial, notes).run();
}

}  // namespace tether::campaign
