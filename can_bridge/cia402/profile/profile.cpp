#include "can_bridge/cia402/profile/profile.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/canopen/sdo_upload.hpp"
#include "can_bridge/cia402/profile/supervision.hpp"
#include "can_bridge/cia402/texts.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {

using canopen::NmtState;
using cia402::Axis;
using cia402::Fault;
using cia402::Node;
using cia402::Sender;
using cia402::Stage;

std::unique_ptr<DriveProfile> make_profile(const Cia402Config& config,
                                           const VehicleConfig& vehicle) {
  return std::make_unique<Cia402Profile>(config, vehicle.wheel_radius_m, vehicle.track_m);
}

Cia402Profile::Cia402Profile(const Cia402Config& config, double wheel_radius_m, double track_m)
    : drives_(config, wheel_radius_m, track_m) {}

std::vector<CanFilter> Cia402Profile::filters() const {
  return cia402::drivetrain_filters(drives_.config, drives_.axes.pdos());
}

// ---------------------------------------------------------------------------- from the bus

void Cia402Profile::on_frame(const CanFrame& frame, Instant now) {
  if (frame.extended || frame.remote) return;
  const Sender sender = cia402::sender_of(frame.id, drives_.config, drives_.axes.pdos());
  switch (sender.kind) {
    case Sender::Kind::other:
      break;
    case Sender::Kind::nmt:
    case Sender::Kind::sync:
    case Sender::Kind::master_heartbeat:
    case Sender::Kind::setpoint:
      on_intruder(frame.id, sender.kind);
      break;
    case Sender::Kind::sdo_request:
      // Reading an object is not commanding.
      if (!is_upload_request(frame)) on_intruder(frame.id, sender.kind);
      break;
    case Sender::Kind::sdo_response:
      on_sdo(frame, drives_.nodes.of(sender.node));
      break;
    case Sender::Kind::heartbeat:
      on_heartbeat(frame, drives_.nodes.of(sender.node), now);
      break;
    case Sender::Kind::emergency:
      on_emergency(frame, drives_.nodes.of(sender.node));
      break;
    case Sender::Kind::feedback:
      on_feedback(frame, drives_.nodes.of(sender.node), now);
      break;
  }
}

void Cia402Profile::on_intruder(std::uint32_t id, Sender::Kind kind) {
  ++counters_.intruder_frames;
  if (std::ranges::find(intruders_, id) == intruders_.end()) intruders_.push_back(id);
  if (kind == Sender::Kind::sdo_request) return;
  fault(Fault{fmt::format("another sender uses 0x{:03X}: only one master may command", id),
              kind == Sender::Kind::nmt});
}

void Cia402Profile::on_sdo(const CanFrame& frame, Node& node) {
  const bool expected = drives_.stage.stage() == Stage::securing ? node.inquiry.on_sdo(frame)
                                                                 : node.startup.on_sdo(frame);
  if (!expected) ++counters_.rejected_frames;
}

void Cia402Profile::on_heartbeat(const CanFrame& frame, Node& node, Instant now) {
  const std::optional<NmtState> state = node.on_heartbeat(frame, now);
  if (!state) {
    ++counters_.rejected_frames;
  } else if (state == NmtState::boot_up) {
    on_boot_up(node);
  } else if (state != NmtState::operational && drives_.supervised()) {
    fault(Fault{fmt::format("{}: left the operational state ({}): full start-up needed", node.name,
                            state == NmtState::stopped ? "stopped" : "pre-operational"),
                true});
  }
}

void Cia402Profile::on_boot_up(Node& node) {
  for (Axis& axis : drives_.axes) {
    if (axis.node() == node.id) axis.reanchor();
  }
  if (drives_.stage.stage() == Stage::configuring) {
    node.startup.on_boot_up();
  } else if (drives_.stage.stage() > Stage::configuring) {
    fault(Fault{
        fmt::format("{}: rebooted: full start-up needed; check its supply voltage", node.name),
        true});
  }
}

void Cia402Profile::on_emergency(const CanFrame& frame, Node& node) {
  if (frame.size != 8) {
    ++counters_.rejected_frames;
    return;
  }
  node.heard = true;
  const auto code = static_cast<std::uint16_t>(canopen::read_integer(frame.data.data(), 2, false));
  for (Axis& axis : drives_.axes) {
    if (axis.node() == node.id) axis.on_emergency(code);
  }
  if (code != canopen::kEmcyReset && drives_.supervised()) {
    fault(Fault{fmt::format("{}: emergency {}: remove the cause, then reset", node.name,
                            cia402::error_text(code))});
  }
  latch_.tell_error_code(drives_.stage, drives_.axes);
}

void Cia402Profile::on_feedback(const CanFrame& frame, Node& node, Instant now) {
  if (!drives_.axes.on_feedback(frame, now)) {
    ++counters_.rejected_frames;
    return;
  }
  node.heard = node.running = true;
  for (std::size_t i = 0; i < drives_.axes.size(); ++i) {
    if (drives_.axes[i].node() == node.id) fault(cia402::check_axis(drives_, i));
  }
  latch_.tell_error_code(drives_.stage, drives_.axes);
}

std::string Cia402Profile::intruder() const {
  std::string ids;
  for (const std::uint32_t id : intruders_) {
    ids += fmt::format("{}0x{:03X}", ids.empty() ? "" : ", ", id);
  }
  return ids.empty() ? ids : ids + " from another sender";
}

// ---------------------------------------------------------------------------- requests

void Cia402Profile::start(Instant) { restart(); }

void Cia402Profile::restart() {
  bring_up_.begin();
  latch_.clear();
}

void Cia402Profile::set_command(const Twist& twist) {
  command_ = is_usable(twist) ? twist : Twist{};
}

void Cia402Profile::enable() {
  if (drives_.stage.stage() == Stage::standby) enabling_.begin();
}

void Cia402Profile::stop(StopKind kind) {
  const Stage stage = drives_.stage.stage();
  if (stage == Stage::enabling || stage == Stage::enabled) stopping_.begin(kind);
}

void Cia402Profile::reset_fault() {
  intruders_.clear();
  const Stage stage = drives_.stage.stage();
  if (stage == Stage::refused || (stage == Stage::faulted && latch_.needs_restart())) {
    restart();
  } else if (stage == Stage::faulted) {
    clearing_.begin();
  }
}

// ---------------------------------------------------------------------------- to the bus

void Cia402Profile::tick(Instant now, std::vector<CanFrame>& out) {
  cia402::StageClock& stage = drives_.stage;
  if (stage.stage() == Stage::idle) return;
  stage.mark(now);
  fault(cia402::watch(drives_, now));
  stage.mark(now);
  std::vector<CanFrame> nmt, service;
  advance(now, nmt, service);
  stage.mark(now);

  out.insert(out.end(), nmt.begin(), nmt.end());
  if (drives_.commanding) send_setpoints(now, out);
  drives_.heartbeat.tick(now, out);
  out.insert(out.end(), service.begin(), service.end());
}

void Cia402Profile::advance(Instant now, std::vector<CanFrame>& nmt,
                            std::vector<CanFrame>& service) {
  switch (drives_.stage.stage()) {
    case Stage::listening:
    case Stage::securing:
    case Stage::configuring:
    case Stage::beating:
    case Stage::activating:
    case Stage::settling:
      bring_up_.tick(now, nmt, service);
      break;
    case Stage::enabling:
      fault(enabling_.tick(now));
      // Commands from before the drives were enabled do not count.
      if (drives_.stage.stage() == Stage::enabled) command_ = {};
      break;
    case Stage::stopping:
      fault(stopping_.tick(now));
      break;
    case Stage::clearing:
      fault(clearing_.tick(now));
      break;
    case Stage::idle:
    case Stage::standby:
    case Stage::enabled:
    case Stage::faulted:
    case Stage::refused:
      break;
  }
}

void Cia402Profile::send_setpoints(Instant now, std::vector<CanFrame>& out) {
  std::array<std::int64_t, 2> targets{};
  // This is the only place that decides whether setpoints are other than zero.
  if (drives_.stage.stage() == Stage::enabled) targets = drives_.axes.target_velocities(command_);
  drives_.axes.send({wanted_controlword(0, now), wanted_controlword(1, now)}, targets, out);
  if (drives_.config.sync) out.push_back(CanFrame::make(canopen::kSync, {}));
}

std::uint16_t Cia402Profile::wanted_controlword(std::size_t i, Instant now) {
  switch (drives_.stage.stage()) {
    case Stage::enabling:
    case Stage::enabled:
      return drives_.axes[i].enabling_controlword();
    case Stage::stopping:
      return stopping_.controlword();
    case Stage::clearing:
      if (drives_.axes[i].in_fault()) return clearing_.controlword();
      break;
    default:
      break;
  }
  return drives_.axes.stop_controlword(i, now);
}

DrivetrainSnapshot Cia402Profile::snapshot(Instant now) const {
  const cia402::Axes& axes = drives_.axes;
  DrivetrainSnapshot result;
  result.phase = cia402::phase_of(drives_.stage.stage());
  result.reason =
      result.phase == DrivePhase::starting ? bring_up_.waiting_for(now) : drives_.stage.reason();
  for (std::size_t i = 0; i < axes.size(); ++i) result.wheels[i] = axes[i].feedback();
  result.feedback_fresh = axes.fresh(now);
  result.standstill = result.feedback_fresh && axes.standing(now);
  return result;
}

}  // namespace tether
