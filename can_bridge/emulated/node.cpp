#include "can_bridge/emulated/node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tether {
namespace {

using canopen::Abort;

constexpr std::int64_t producer_of(std::int64_t setting) { return setting >> 16; }
constexpr std::int64_t milliseconds_of(std::int64_t setting) { return setting & 0xFFFF; }
constexpr bool is_off(std::int64_t setting) {
  return producer_of(setting) == 0 || milliseconds_of(setting) == 0;
}

}  // namespace

EmulatedMasterWatch::EmulatedMasterWatch(const ObjectDictionary& dictionary,
                                         const std::vector<Handle>& consumers,
                                         std::vector<Handle> watchdogs)
    : dictionary_(dictionary), watchdogs_(std::move(watchdogs)) {
  for (const Handle h : consumers) consumers_.push_back({.object = h});
}

void EmulatedMasterWatch::reset() {
  for (Consumer& consumer : consumers_) consumer.active = false;
  contact_ = false;
}

std::optional<Abort> EmulatedMasterWatch::refuses(Handle h, std::int64_t value) const {
  constexpr std::uint32_t kParameterIncompatibility = 0x0604'0043;
  bool mine = false;
  bool clash = false;
  for (const Consumer& consumer : consumers_) {
    if (consumer.object == h) {
      mine = true;
      continue;
    }
    const std::int64_t other = dictionary_.value(consumer.object);
    clash = clash || (!is_off(other) && producer_of(other) == producer_of(value));
  }
  if (!mine) return std::nullopt;
  constexpr std::int64_t kHighestNode = 127;
  if (producer_of(value) > kHighestNode) return Abort::invalid_value;
  if (!is_off(value) && clash) return static_cast<Abort>(kParameterIncompatibility);
  return std::nullopt;
}

void EmulatedMasterWatch::written(Handle h) {
  for (Consumer& consumer : consumers_) {
    if (consumer.object == h) consumer.active = false;
  }
}

bool EmulatedMasterWatch::on_heartbeat(const CanFrame& frame, Instant now) {
  constexpr auto kBootUp = static_cast<std::uint8_t>(canopen::NmtState::boot_up);
  if (frame.size != 1 || frame.data[0] == kBootUp) return false;
  for (Consumer& consumer : consumers_) {
    const std::int64_t setting = dictionary_.value(consumer.object);
    if (is_off(setting)) continue;
    if (frame.id != canopen::kHeartbeat + static_cast<std::uint32_t>(producer_of(setting)))
      continue;
    consumer.active = true;
    consumer.last = now;
    return true;
  }
  return false;
}

bool EmulatedMasterWatch::heartbeat_missed(Instant now) {
  bool missed = false;
  for (Consumer& consumer : consumers_) {
    if (!consumer.active) continue;
    const std::int64_t limit_ms = milliseconds_of(dictionary_.value(consumer.object));
    if (now - consumer.last < std::chrono::milliseconds{limit_ms}) continue;
    consumer.active = false;
    missed = true;
  }
  return missed;
}

void EmulatedMasterWatch::contact(Instant now) {
  contact_ = true;
  last_contact_ = now;
}

bool EmulatedMasterWatch::watchdog_missed(Instant now) {
  if (!contact_) return false;
  for (const Handle h : watchdogs_) {
    const Duration limit = std::chrono::milliseconds{dictionary_.value(h)};
    if (limit <= Duration{0} || now - last_contact_ < limit) continue;
    contact_ = false;
    return true;
  }
  return false;
}

using canopen::Abort;
using canopen::NmtCommand;
using canopen::NmtState;

namespace {

/// The error register (CiA 301, 7.5.2.2) for an error code, whose first digit is its kind: 2
/// current, 3 voltage, 4 temperature, 8 communication, F manufacturer.
std::uint8_t error_register(std::uint16_t code) {
  static constexpr std::array<std::uint8_t, 16> kBits{0,    0, 0x02, 0x04, 0x08, 0, 0, 0,
                                                      0x10, 0, 0,    0,    0,    0, 0, 0x80};
  constexpr unsigned kGeneric = 0x01;
  return code == 0 ? 0 : static_cast<std::uint8_t>(kGeneric | kBits[code >> 12]);
}

}  // namespace

EmulatedNode::EmulatedNode(const Cia402Config& config, std::uint8_t node, Instant now)
    : id_(node),
      objects_(make_drive_objects(config, node)),
      sdo_(node, objects_.dictionary, [this](Handle h, std::int64_t v) { return write(h, v); }),
      pdos_(objects_.dictionary, *this),
      watch_(objects_.dictionary, objects_.heartbeat_consumers, objects_.watchdogs) {
  for (const AxisObjects& axis : objects_.axes) {
    axes_.push_back({.objects = axis,
                     .machine = EmulatedAxis(config.emulated_brake),
                     .encoder = {},
                     .coasting_radps2 = config.emulated_coasting_radps2});
  }
  boot(now, true);
}

// ---------------------------------------------------------------------------- frames and time

void EmulatedNode::on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) {
  if (nmt_ == NmtState::boot_up || frame.extended || frame.remote) return;
  if (frame.id == canopen::kNmt) {
    on_nmt(frame, now);
  } else if (frame.id > canopen::kHeartbeat) {
    on_heartbeat(frame, now);
  } else if (frame.id == canopen::kSdoRequest + id_) {
    on_sdo(frame, now);
  } else if (operational()) {
    on_process_data(frame, now);
  }
  flush(now, out);
}

void EmulatedNode::on_sdo(const CanFrame& frame, Instant now) {
  if (nmt_ == NmtState::stopped) return;
  watch_.contact(now);
  if (const auto answer = sdo_.on_request(frame)) outbox_.push_back(*answer);
}

void EmulatedNode::on_process_data(const CanFrame& frame, Instant now) {
  if (frame.id == canopen::kSync) {
    pdos_.on_sync(now, outbox_);
    return;
  }
  switch (pdos_.on_frame(frame, now)) {
    case EmulatedPdos::Received::not_mine:
      return;
    case EmulatedPdos::Received::too_short:
      ++counters_.rpdo_too_short;
      if (!length_error_) {
        length_error_ = true;
        raise(canopen::kEmcyPdoLength);
      }
      return;
    case EmulatedPdos::Received::taken:
      length_error_ = false;
      watch_.contact(now);
      settle_errors();
      return;
  }
}

void EmulatedNode::tick(Instant now, std::vector<CanFrame>& out) {
  const Duration dt = now - last_tick_;
  if (dt <= Duration{0}) return;
  last_tick_ = now;
  if (silent_ && now >= silent_until_) silent_ = false;
  if (nmt_ == NmtState::boot_up && now >= boot_end_) finish_boot(now);
  if (!firmware_runs_) {
    for (EmulatedDriveAxis& axis : axes_) axis.coast(dt);
    return;
  }
  if (nmt_ != NmtState::boot_up) watch_master(now);
  for (EmulatedDriveAxis& axis : axes_) {
    axis.run(objects_.dictionary, dt);
    axis.show(objects_.dictionary, connection_error_);
  }
  settle_errors();
  if (nmt_ != NmtState::boot_up) produce_heartbeat(now);
  if (operational()) pdos_.tick(now, outbox_);
  flush(now, out);
}

void EmulatedNode::flush(Instant now, std::vector<CanFrame>& out) {
  if (outbox_.empty()) return;
  if (!silent_ || now >= silent_until_) out.insert(out.end(), outbox_.begin(), outbox_.end());
  outbox_.clear();
}

// ---------------------------------------------------------------------------- NMT

void EmulatedNode::boot(Instant now, bool whole_node) {
  nmt_ = NmtState::boot_up;
  boot_end_ = now + (whole_node ? kBootTime : kCommunicationBootTime);
  constexpr std::uint16_t kCommunicationFirst = 0x1002;  // the error register stays
  constexpr std::uint16_t kCommunicationLast = 0x1FFF;
  objects_.dictionary.restore(whole_node ? 0 : kCommunicationFirst,
                              whole_node ? 0xFFFF : kCommunicationLast);
  pdos_.reload();
  sdo_.reset();
  outbox_.clear();
  watch_.reset();
  heartbeat_time_ = Duration{0};
  connection_error_ = 0;
  length_error_ = false;
  ++counters_.boots;
  if (!whole_node) return;
  firmware_runs_ = false;
  any_error_ = false;
  last_tick_ = now;
  for (EmulatedDriveAxis& axis : axes_) axis.machine.power_up();
}

void EmulatedNode::finish_boot(Instant now) {
  if (!firmware_runs_) {
    firmware_runs_ = true;
    for (EmulatedDriveAxis& axis : axes_) axis.encoder.restart();
  }
  outbox_.push_back(canopen::heartbeat_frame(id_, NmtState::boot_up));
  enter(NmtState::pre_operational, now);
}

void EmulatedNode::on_nmt(const CanFrame& frame, Instant now) {
  if (frame.size != 2 || (frame.data[1] != 0 && frame.data[1] != id_)) return;
  switch (static_cast<NmtCommand>(frame.data[0])) {
    case NmtCommand::start:
      enter(NmtState::operational, now);
      break;
    case NmtCommand::stop:
      stop_powered_axes();
      enter(NmtState::stopped, now);
      break;
    case NmtCommand::pre_operational:
      enter(NmtState::pre_operational, now);
      break;
    case NmtCommand::reset_node:
      boot(now, true);
      break;
    case NmtCommand::reset_communication:
      stop_powered_axes();
      boot(now, false);
      break;
  }
}

void EmulatedNode::enter(NmtState state, Instant now) {
  if (nmt_ == state) return;
  nmt_ = state;
  watch_.wait_for_contact();
  length_error_ = false;
  if (state == NmtState::operational) pdos_.start(now);
}

void EmulatedNode::produce_heartbeat(Instant now) {
  const Duration period = std::chrono::milliseconds{value(objects_.heartbeat_time)};
  if (period != heartbeat_time_) {
    heartbeat_time_ = period;
    next_heartbeat_ = now + period;
  }
  if (period <= Duration{0} || now < next_heartbeat_) return;
  next_heartbeat_ += period;
  if (next_heartbeat_ <= now) next_heartbeat_ = now + period;  // after a pause, no burst
  outbox_.push_back(canopen::heartbeat_frame(id_, nmt_));
}

// ---------------------------------------------------------------------------- objects

std::optional<Abort> EmulatedNode::refuses(Handle h, std::int64_t value) const {
  if (const auto code = pdos_.refuses(h, value)) return code;
  if (const auto code = watch_.refuses(h, value)) return code;
  for (const EmulatedDriveAxis& axis : axes_) {
    const AxisObjects& o = axis.objects;
    if (h == o.mode && value != 0 && value != EmulatedAxis::kProfileVelocity) {
      return Abort::invalid_value;
    }
    if (h == o.mode && value == 0 && axis.machine.powered()) return Abort::device_state;
    if (h == o.quick_stop_option && (value == 3 || value == 4)) return Abort::invalid_value;
  }
  return std::nullopt;
}

std::optional<Abort> EmulatedNode::write(Handle h, std::int64_t value) {
  if (const auto code = refuses(h, value)) return code;
  store(h, value);
  const std::uint16_t index = objects_.dictionary.entry(h).ref.index;
  if (canopen::is_pdo_parameter(index)) pdos_.reload();
  watch_.written(h);
  return std::nullopt;
}

void EmulatedNode::store(Handle h, std::int64_t value) {
  objects_.dictionary.store(h, value);
  for (EmulatedDriveAxis& axis : axes_) {
    if (axis.objects.controlword == h) {
      axis.machine.write_control(static_cast<std::uint16_t>(value & 0xFFFF));
    }
  }
}

void EmulatedNode::receive_object(Handle h, std::int64_t value) {
  const ObjectDictionary::Entry& entry = objects_.dictionary.entry(h);
  if (value < entry.minimum || value > entry.maximum || refuses(h, value)) return;
  store(h, value);
}

// ---------------------------------------------------------------------------- watching the master

void EmulatedNode::on_heartbeat(const CanFrame& frame, Instant now) {
  if (!watch_.on_heartbeat(frame, now)) return;
  connection_error_ = 0;
  settle_errors();
}

void EmulatedNode::watch_master(Instant now) {
  if (watch_.heartbeat_missed(now)) {
    ++counters_.heartbeat_timeouts;
    connection_error_ = canopen::kEmcyHeartbeat;
    raise(canopen::kEmcyHeartbeat);
    for (EmulatedDriveAxis& axis : axes_) lose_connection(axis, canopen::kEmcyHeartbeat);
    if (operational()) leave_operational(now);
  }
  if (!operational()) return;
  if (watch_.watchdog_missed(now)) {
    ++counters_.watchdog_timeouts;
    trip_all(canopen::kEmcyHeartbeat);
  }
  if (pdos_.deadline_missed(now)) {
    ++counters_.rpdo_timeouts;
    trip_all(canopen::kEmcyRpdoTimeout);
  }
}

void EmulatedNode::lose_connection(EmulatedDriveAxis& axis, std::uint16_t code) {
  switch (value(axis.objects.connection_option, 1)) {
    case 1:
      axis.machine.trip(code);
      break;
    case 2:
      axis.machine.disable_voltage();
      break;
    case 3:
      axis.machine.quick_stop();
      break;
    default:
      break;
  }
}

void EmulatedNode::stop_powered_axes() {
  constexpr std::uint16_t kCommunication = 0x8100;
  for (EmulatedDriveAxis& axis : axes_) {
    if (axis.machine.powered()) lose_connection(axis, kCommunication);
  }
}

void EmulatedNode::leave_operational(Instant now) {
  switch (value(objects_.error_behaviour)) {
    case 0:
      enter(NmtState::pre_operational, now);
      break;
    case 2:
      enter(NmtState::stopped, now);
      break;
    default:
      break;
  }
}

void EmulatedNode::trip_all(std::uint16_t code) {
  for (EmulatedDriveAxis& axis : axes_) axis.machine.trip(code);
  raise(code);
}

// ---------------------------------------------------------------------------- errors

void EmulatedNode::raise(std::uint16_t code) {
  any_error_ = true;
  send_emcy(code);
}

void EmulatedNode::send_emcy(std::uint16_t code) {
  const std::uint8_t bits = error_register(code);
  objects_.dictionary.store(objects_.error_register, bits);
  if (nmt_ == NmtState::boot_up || nmt_ == NmtState::stopped) return;
  ++counters_.emcy_sent;
  outbox_.push_back(CanFrame::make(canopen::kEmcy + id_,
                                   {static_cast<std::uint8_t>(code & 0xFF),
                                    static_cast<std::uint8_t>(code >> 8), bits, 0, 0, 0, 0, 0}));
}

void EmulatedNode::settle_errors() {
  const bool faulty = std::any_of(axes_.begin(), axes_.end(), [](const EmulatedDriveAxis& axis) {
    return axis.machine.error_code() != 0;
  });
  const bool any = faulty || connection_error_ != 0 || length_error_;
  for (EmulatedDriveAxis& axis : axes_)
    axis.machine.set_warning(connection_error_ != 0 || length_error_);
  if (any_error_ && !any) send_emcy(canopen::kEmcyReset);
  any_error_ = any;
}

// ---------------------------------------------------------------------------- axes

void EmulatedNode::set_wheels(const WheelStates& wheels) {
  for (EmulatedDriveAxis& axis : axes_) {
    axis.encoder.turn(wheels.angle_rad[axis.objects.wheel], wheels.speed_radps[axis.objects.wheel]);
  }
}

bool EmulatedNode::powers(std::size_t wheel) const {
  return std::ranges::any_of(axes_, [wheel](const EmulatedDriveAxis& axis) {
    return axis.objects.wheel == wheel && axis.machine.powered();
  });
}

void EmulatedNode::put_wheel_targets(std::array<double, 2>& targets_radps) const {
  for (const EmulatedDriveAxis& axis : axes_) {
    targets_radps[axis.objects.wheel] = axis.wheel_target_radps();
  }
}

// ---------------------------------------------------------------------------- faults, counters

void EmulatedNode::inject(const DriveFault& fault, Instant now) {
  switch (fault.kind) {
    case DriveFault::Kind::none:
      silent_ = false;
      sdo_.refuse_nothing();
      for (EmulatedDriveAxis& axis : axes_) {
        axis.encoder.set_frozen(false);
        axis.encoder.set_slip(0.0);
        axis.push_radps2 = 0.0;
        axis.brake_share = 1.0;
      }
      break;
    case DriveFault::Kind::fault: {
      constexpr std::uint16_t kPowerElectronics = 0x7500;
      if (!firmware_runs_) break;
      const double code = std::clamp(fault.value, 0.0, 65535.0);
      const auto chosen = static_cast<std::uint16_t>(code);
      trip_all(chosen == 0 ? kPowerElectronics : chosen);
      break;
    }
    case DriveFault::Kind::reboot:
      boot(now, true);
      break;
    case DriveFault::Kind::silence:
      silent_ = true;
      silent_until_ =
          fault.value > 0.0 ? now + from_seconds(std::min(fault.value, 1e6)) : Instant::max();
      break;
    case DriveFault::Kind::sdo_abort:
      sdo_.refuse(static_cast<std::uint16_t>(std::clamp(fault.value, 0.0, 65535.0)),
                  Abort::no_object);
      break;
    case DriveFault::Kind::encoder_freeze:
      for (EmulatedDriveAxis& axis : axes_) axis.encoder.set_frozen(true);
      break;
    case DriveFault::Kind::wheel_slip:
      for (EmulatedDriveAxis& axis : axes_)
        axis.encoder.set_slip(std::clamp(fault.value, 0.0, 1.0));
      break;
    case DriveFault::Kind::push:
      for (EmulatedDriveAxis& axis : axes_) axis.push_radps2 = fault.value;
      break;
    case DriveFault::Kind::weak_brake:
      for (EmulatedDriveAxis& axis : axes_) axis.brake_share = std::clamp(fault.value, 0.0, 1.0);
      break;
  }
}

EmulatedNode::Counters EmulatedNode::counters() const {
  Counters all = counters_;
  all.sdo_aborts = sdo_.aborts();
  return all;
}

void EmulatedNode::list(CounterList& out) const {
  const Counters c = counters();
  const auto add = [&](const char* name, std::int64_t value) {
    out.emplace_back(fmt::format("node{}.{}", id_, name), value);
  };
  add("boots", c.boots);
  add("emcy_sent", c.emcy_sent);
  add("heartbeat_timeouts", c.heartbeat_timeouts);
  add("watchdog_timeouts", c.watchdog_timeouts);
  add("rpdo_timeouts", c.rpdo_timeouts);
  add("rpdo_too_short", c.rpdo_too_short);
  add("sdo_aborts", c.sdo_aborts);
}

EmulatedCia402::EmulatedCia402(const Cia402Config& config, Instant now) {
  for (const std::uint8_t id : config.nodes()) {
    nodes_.push_back(std::make_unique<EmulatedNode>(config, id, now));
  }
}

void EmulatedCia402::on_frame(const CanFrame& frame, Instant now, std::vector<CanFrame>& out) {
  for (const auto& node : nodes_) node->on_frame(frame, now, out);
}

void EmulatedCia402::tick(Instant now, std::vector<CanFrame>& out) {
  for (const auto& node : nodes_) node->tick(now, out);
}

void EmulatedCia402::set_wheels(const WheelStates& wheels) {
  for (const auto& node : nodes_) node->set_wheels(wheels);
}

std::array<double, 2> EmulatedCia402::wheel_targets_radps() const {
  std::array<double, 2> targets_radps{};
  for (const auto& node : nodes_) node->put_wheel_targets(targets_radps);
  return targets_radps;
}

void EmulatedCia402::inject(const DriveFault& fault, Instant now) {
  for (const auto& node : nodes_) {
    if (fault.node == 0 || fault.node == node->id()) node->inject(fault, now);
  }
}

void EmulatedCia402::list(CounterList& out) const {
  for (const auto& node : nodes_) node->list(out);
}

std::unique_ptr<EmulatedDrivetrain> emulate(const Cia402Config& config, Instant now) {
  return std::make_unique<EmulatedCia402>(config, now);
}

}  // namespace tether
