#include "tests/campaign/unknown_sender.hpp"

#include "can_bridge/bus/canopen.hpp"

namespace tether::campaign {

namespace {

constexpr std::uint8_t kBridgeNode = 0x7F;  // drivetrains/two_node_cia402.toml
/// Sequence that switches a drive on, one word per step.
constexpr std::uint16_t kControlWords[] = {canopen::kControlShutdown, canopen::kControlSwitchOn,
                                           canopen::kControlEnableOperation};

std::uint8_t node_of(const Fault& fault) { return static_cast<std::uint8_t>(fault.node); }

}  // namespace

UnknownSender::UnknownSender(const Trial& trial, EventLoop& loop, CanPort& port,
                             std::vector<Instant>& commanded)
    : loop_(loop),
      port_(port),
      commanded_(commanded),
      random_(random_stream(trial.seed, "stranger")) {}

void UnknownSender::begin(const Fault& fault) {
  switch (fault.kind) {
    case FaultKind::nmt:
      return send_nmt(fault);
    case FaultKind::emcy:
      return send_emcy(fault);
    case FaultKind::sdo_write:
      return write_objects(fault);
    case FaultKind::foreign_master:
      return be_master(fault);
    default:
      return;
  }
}

void UnknownSender::command(const CanFrame& frame) {
  commanded_.push_back(loop_.now());
  port_.send(frame);
}

void UnknownSender::send_nmt(const Fault& fault) {
  using Command = canopen::NmtCommand;
  constexpr Command kCommands[] = {Command::start, Command::stop, Command::pre_operational,
                                   Command::reset_node, Command::reset_communication};
  const auto which = static_cast<std::size_t>(5.0 * fault.share);
  const bool all = uniform_01(random_) < 0.5;
  port_.send(canopen::nmt_frame(kCommands[which], all ? std::uint8_t{0} : node_of(fault)));
}

void UnknownSender::send_emcy(const Fault& fault) {
  constexpr std::uint8_t kGeneric = 0x10;
  const auto high = static_cast<std::uint8_t>(255.0 * fault.share);
  CanFrame frame =
      CanFrame::make(canopen::kEmcy + node_of(fault), {kGeneric, high, 1, 0, 0, 0, 0, 0});
  if (uniform_01(random_) < 0.2) frame.size = 3;  // malformed
  port_.send(frame);
}

void UnknownSender::write_objects(const Fault& fault) {
  const ObjectRef control{0x6040, 0, 2, false}, target{0x60FF, 0, 4, true},
      mode{0x6060, 0, 1, true}, heartbeat{0x1017, 0, 2, false};
  const double which = uniform_01(random_);
  int step = 0;
  for (Instant t = fault.when; t <= fault.until; t += std::chrono::milliseconds{5}) {
    CanFrame frame;
    if (which < 0.4) {
      frame = canopen::sdo_download(node_of(fault), control, kControlWords[step++ % 3]);
    } else if (which < 0.7) {
      const auto speed = static_cast<std::int64_t>(20000.0 * (fault.share - 0.5));
      frame = canopen::sdo_download(node_of(fault), target, speed);
    } else if (which < 0.85) {
      frame = canopen::sdo_download(node_of(fault), mode, 1);
    } else {
      frame = canopen::sdo_download(node_of(fault), heartbeat, 0);
    }
    loop_.at(t, Priority::node, [this, frame](Instant) { command(frame); });
  }
}

void UnknownSender::be_master(const Fault& fault) {
  const double which = uniform_01(random_);
  int step = 0;
  for (Instant t = fault.when; t <= fault.until; t += std::chrono::milliseconds{5}) {
    loop_.at(t, Priority::node, [this, fault, which, step](Instant) {
      if (which < 0.6) return send_setpoint(fault, step);
      if (which < 0.8) return command(CanFrame::make(canopen::kSync, {}));
      command(canopen::heartbeat_frame(kBridgeNode, canopen::NmtState::operational));
    });
    ++step;
  }
}

void UnknownSender::send_setpoint(const Fault& fault, int step) {
  CanFrame frame = CanFrame::make(canopen::pdo_id(false, 1, node_of(fault)), {0, 0, 0, 0, 0, 0});
  const std::int64_t speed = static_cast<std::int64_t>(20000.0 * (fault.share - 0.5));
  canopen::write_integer(frame.data.data(), 2, kControlWords[step % 3]);
  canopen::write_integer(frame.data.data() + 2, 4, speed);
  command(frame);
}

}  // namespace tether::campaign
