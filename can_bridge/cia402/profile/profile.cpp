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

namespace {

/// Longest duration of a stop (SafetyCore::kStopTimeout).
constexpr Duration kBrakingWithoutFeedback = std::chrono::seconds(5);

std::string rebooted_text(const Node& node) {
  return fmt::format("{}: rebooted: full start-up needed; check its supply voltage", node.name);
}

}  // namespace

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
      for (Node& node : drives_.nodes) node.on_foreign_nmt(frame);
      [[fallthrough]];
    case Sender::Kind::sync:
    case Sender::Kind::master_heartbeat:
    case Sender::Kind::setpoint:
      on_intruder(frame, sender);
      break;
    case Sender::Kind::sdo_request:
      // Reading an object is not commanding.
      if (!is_upload_request(frame)) on_intruder(frame, sender);
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

void Cia402Profile::on_intruder(const CanFrame& frame, const Sender& sender) {
  ++counters_.intruder_frames;
  if (std::ranges::find(intruders_, frame.id) == intruders_.end()) intruders_.push_back(frame.id);
  if (sender.kind == Sender::Kind::sdo_request) return on_foreign_sdo(frame, sender.node);
  if (sender.kind == Sender::Kind::setpoint) drives_.axes.doubt(sender.node);
  fault(Fault{fmt::format("another sender uses 0x{:03X}: only one master may command", frame.id),
              sender.kind == Sender::Kind::nmt});
}

void Cia402Profile::on_foreign_sdo(const CanFrame& frame, std::uint8_t node) {
  // Before that, start-up will write it.
  if (drives_.stage.stage() < Stage::configuring) return;
  const std::optional<ObjectRef> object = written_object(frame);
  if (!object || !cia402::is_vital(drives_.config, node, object->index)) return;
  ++counters_.intruder_writes;
  distrust_part(cia402::stop_part(object->index), node);
  drives_.axes.doubt(node);
  fault(Fault{fmt::format("{}: another sender writes {} by SDO: only one master may configure; "
                          "reset configures the drives again",
                          drives_.nodes.of(node).name, cia402::object_text(*object)),
              true});
}

void Cia402Profile::distrust_part(cia402::StopPart part, std::uint8_t node) {
  if (part == cia402::StopPart::pdo) drives_.nodes.of(node).pdos_doubtful = true;
  for (std::size_t i = 0; i < drives_.axes.size(); ++i) {
    if (drives_.axes[i].node() != node) continue;
    if (part == cia402::StopPart::quick_stop) drives_.axes.stop_by_setpoint(i);
    if (part == cia402::StopPart::other) drives_.axes.stop_by_quick_stop(i);
  }
}

bool Cia402Profile::withholds() const { return assurance_.withholds() || braking_.withholds(); }

void Cia402Profile::on_sdo(const CanFrame& frame, Node& node) {
  bool expected = true;
  switch (drives_.stage.stage()) {
    case Stage::securing:
      expected = node.inquiry.on_sdo(frame);
      break;
    case Stage::configuring:
      expected = node.startup.wants_reset_again() ? node.inquiry.on_sdo(frame)
                                                  : node.startup.on_sdo(frame);
      break;
    case Stage::verifying:
      expected = node.read_back.on_sdo(frame);
      break;
    default:
      expected = !node.by_sdo || node.stopper.on_sdo(frame);
      break;
  }
  if (!expected) ++counters_.rejected_frames;
}

void Cia402Profile::on_heartbeat(const CanFrame& frame, Node& node, Instant now) {
  const std::optional<NmtState> state = node.on_heartbeat(frame, now);
  if (!state) {
    ++counters_.rejected_frames;
  } else if (state == NmtState::boot_up) {
    on_boot_up(node);
  } else if (state == NmtState::operational && drives_.stage.reason() == rebooted_text(node)) {
    // Only NMT "start" leads there after a reboot, and the bridge has not sent it.
    drives_.stage.tell(fmt::format(
        "{}: sent a boot-up message, but is still operational, so it did not reboot: a second "
        "boot-up message after its start, or another device with its node id",
        node.name));
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
  // Without power, but its wheel may roll: it is asked again.
  if (drives_.stage.stage() <= Stage::securing) node.begin_inquiry();
  if (drives_.stage.stage() == Stage::configuring) {
    node.startup.on_boot_up();
  } else if (drives_.stage.stage() > Stage::configuring) {
    fault(Fault{rebooted_text(node), true});
  }
}

void Cia402Profile::on_emergency(const CanFrame& frame, Node& node) {
  if (frame.size != 8) {
    ++counters_.rejected_frames;
    return;
  }
  node.heard = true;
  const auto code = static_cast<std::uint16_t>(canopen::read_integer(frame.data.data(), 2, false));
  if (drives_.config.is_warning(code)) {
    ++counters_.warnings;
    const std::pair warning{node.id, code};
    if (std::ranges::find(warnings_, warning) == warnings_.end()) warnings_.push_back(warning);
    return;
  }
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
  if (drives_.supervised()) watch_senders(frame.id, node, now);
  for (std::size_t i = 0; i < drives_.axes.size(); ++i) {
    if (drives_.axes[i].node() == node.id) fault(cia402::check_axis(drives_, i));
  }
  latch_.tell_error_code(drives_.stage, drives_.axes);
}

void Cia402Profile::watch_senders(std::uint32_t id, const Node& node, Instant now) {
  if (drives_.axes.count_sender(id)) return;
  ++counters_.surplus_feedback;
  if (!drives_.axes.two_sources(id)) return;
  // The standstill that one of them shows may be the other's.
  drives_.axes.distrust_standstill(now + kBrakingWithoutFeedback);
  fault(
      Fault{fmt::format("two sources send 0x{:03X}, feedback of {}: has another device its node "
                        "id, or are its frames replayed? Feedback is not believed",
                        id, node.name)});
}

std::string Cia402Profile::intruder() const {
  std::string ids;
  for (const std::uint32_t id : intruders_) {
    ids += fmt::format("{}0x{:03X}", ids.empty() ? "" : ", ", id);
  }
  return ids.empty() ? ids : ids + " from another sender";
}

std::string Cia402Profile::warnings() const {
  std::string all;
  for (const auto& [node, code] : warnings_) {
    all += fmt::format("{}{}: {}", all.empty() ? "" : "; ", cia402::node_name(drives_.config, node),
                       cia402::error_text(code));
  }
  return all;
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
  if (drives_.stage.stage() != Stage::standby) return;
  drives_.axes.distrust_standstill(Instant::min());  // distrusts the standstill of an earlier stop
  enabling_.begin();
}

void Cia402Profile::stop(StopKind kind) {
  const Stage stage = drives_.stage.stage();
  if (stage >= Stage::verifying && stage <= Stage::enabled) stopping_.begin(kind);
}

void Cia402Profile::reset_fault() {
  intruders_.clear();
  warnings_.clear();
  drives_.axes.restart_sender_count();
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
  fault(assurance_.tick(now, nmt));
  fault(braking_.tick(now, assurance_.stopping()));
  stage.mark(now);

  out.insert(out.end(), nmt.begin(), nmt.end());
  if (drives_.commanding) {
    send_setpoints(now, out);
  } else {
    drives_.axes.bound_speeds(now, {});
  }
  if (!withholds()) drives_.heartbeat.tick(now, out);
  assurance_.send_by_sdo(now, service);
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
    case Stage::verifying:
    case Stage::enabling:
      fault(enabling_.tick(now, service));
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
  drives_.axes.bound_speeds(now, targets);
  std::vector<CanFrame> setpoints;
  drives_.axes.send({wanted_controlword(0, now), wanted_controlword(1, now)}, targets, setpoints);
  for (const CanFrame& frame : setpoints) {
    const Sender to = cia402::sender_of(frame.id, drives_.config, drives_.axes.pdos());
    if (assurance_.withholds_from(drives_.nodes.of(to.node))) continue;
    if (braking_.withholds_from(to.node)) continue;
    out.push_back(frame);
  }
  if (!drives_.config.sync || withholds()) return;
  out.push_back(CanFrame::make(canopen::kSync, {}));
  // Before they are configured, drives may have other PDOs than ours.
  drives_.supervised() ? drives_.axes.on_sync() : drives_.axes.restart_sender_count();
}

std::uint16_t Cia402Profile::wanted_controlword(std::size_t i, Instant now) {
  switch (drives_.stage.stage()) {
    case Stage::enabling:
    case Stage::enabled:
      return drives_.axes[i].enabling_controlword();
    case Stage::stopping:
      return stopping_.controlword(i);
    case Stage::clearing:
      // A fault reaction is still braking.
      if (drives_.axes[i].state() == canopen::DriveState::fault) return clearing_.controlword();
      break;
    default:
      break;
  }
  return drives_.axes.stop_controlword(i, now);
}

bool Cia402Profile::in_doubt(Instant now) const {
  const Stage stage = drives_.stage.stage();
  const bool asking = stage == Stage::listening || stage == Stage::securing;
  for (const Node& node : drives_.nodes) {
    if (asking && (node.heard || node.lost) &&
        node.inquiry.verdict() != cia402::StandstillInquiry::Verdict::standing) {
      return true;
    }
  }
  return drives_.axes.in_doubt(0, now) || drives_.axes.in_doubt(1, now);
}

DriveProfile::Counters Cia402Profile::counters() const {
  Counters all = counters_;
  all.stops_by_sdo = assurance_.stops_by_sdo();
  all.heartbeat_withheld = assurance_.times_withheld();
  all.brake_escalations = braking_.escalations();
  return all;
}

DrivetrainSnapshot Cia402Profile::snapshot(Instant now) const {
  const cia402::Axes& axes = drives_.axes;
  DrivetrainSnapshot result;
  result.phase = cia402::phase_of(drives_.stage.stage());
  result.reason =
      result.phase == DrivePhase::starting ? bring_up_.waiting_for(now) : drives_.stage.reason();
  for (const std::string& more : {assurance_.text(), braking_.text()}) {
    if (!more.empty()) result.reason += (result.reason.empty() ? "" : "; ") + more;
  }
  for (std::size_t i = 0; i < axes.size(); ++i) {
    WheelFeedback& wheel = result.wheels[i];
    wheel = axes[i].feedback();
    wheel.fastest_radps = axes[i].fastest_radps(now).value_or(wheel.speed_radps);
  }
  result.in_doubt = in_doubt(now);
  result.feedback_fresh = axes.fresh(now);
  result.standstill = result.feedback_fresh && axes.standing(now);
  result.turning = axes.turning(now);
  return result;
}

}  // namespace tether
