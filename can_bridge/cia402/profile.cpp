#include "can_bridge/cia402/profile.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "can_bridge/bus/canopen.hpp"
#include "can_bridge/bus/sdo_upload.hpp"
#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/drives.hpp"
#include "can_bridge/cia402/fault_latch.hpp"
#include "can_bridge/cia402/startup.hpp"
#include "common/vehicle/vehicle_config.hpp"

/// Faults of supervised drives; nullopt: nothing.
namespace tether::cia402 {

/// In every tick: drives without heartbeat; while enabling or enabled, feedback that is too old. A
/// node without heartbeat has no known state any more.
std::optional<Fault> watch(Drives& drives, Instant now);

/// After each feedback: Fault in its statusword, another mode of operation (a drive may show none
/// until it is enabled, if it did so in its start-up), OperationEnabled left or power stage on
/// unasked.
std::optional<Fault> check_axis(const Drives& drives, std::size_t i);

/// The fault of an axis whose drive shows another mode of operation than profile velocity.
Fault wrong_mode(const Axis& axis);

namespace {

using canopen::DriveState;

bool powered(std::optional<DriveState> state) {
  return state == DriveState::switched_on || state == DriveState::operation_enabled ||
         state == DriveState::quick_stop_active;
}

}  // namespace

std::optional<Fault> watch(Drives& drives, Instant now) {
  std::optional<Fault> first;
  if (drives.supervised()) {
    for (Node& node : drives.nodes) {
      if (now - node.heartbeat_stamp < drives.heartbeat_timeout()) continue;
      node.state.reset();
      if (first) continue;
      first = Fault{fmt::format("{}: no heartbeat for {} ms: check its supply and the CAN plug",
                                node.name, drives.config.drive_heartbeat_timeout_ms),
                    true};
    }
  }
  const Stage stage = drives.stage.stage();
  if (first || stage < Stage::verifying || stage > Stage::enabled) return first;
  for (std::size_t i = 0; i < drives.axes.size(); ++i) {
    if (drives.axes[i].fresh(now)) continue;
    return Fault{drives.axes.feedback_text(i), false, Fault::Cause::feedback};
  }
  return std::nullopt;
}

std::optional<Fault> check_axis(const Drives& drives, std::size_t i) {
  const Axis& axis = drives.axes[i];
  const Stage stage = drives.stage.stage();
  if (!drives.supervised() || stage == Stage::faulted || stage == Stage::clearing) {
    return std::nullopt;
  }
  if (axis.in_fault()) return fault_of_axis(drives.axes, i);
  const std::int64_t mode = axis.mode().value_or(kProfileVelocity);
  const bool not_shown_yet =
      mode == 0 && stage != Stage::enabled && drives.nodes.show_mode_late(axis.node());
  if (mode != kProfileVelocity && !not_shown_yet) return wrong_mode(axis);
  if (stage == Stage::enabled && axis.state() != DriveState::operation_enabled) {
    return Fault{
        fmt::format("{}: went from OperationEnabled to {} unasked: check its main supply, "
                    "STO and enable inputs",
                    axis.name(), canopen::to_string(axis.state()))};
  }
  if ((stage == Stage::standby || stage == Stage::verifying) && powered(axis.confirmed_state())) {
    return Fault{fmt::format("{}: is in {} unasked: who switched it on?", axis.name(),
                             canopen::to_string(axis.state()))};
  }
  return std::nullopt;
}

Fault wrong_mode(const Axis& axis) {
  const std::int64_t mode = axis.mode().value_or(0);
  return {
      fmt::format("{}: mode of operation is {}, not 3 (profile velocity): {}", axis.name(), mode,
                  mode != 0 ? "another tool changed it?"
                            : "the drive shows none. If its mode display blinks, leave "
                              "mode_display out of the TPDOs"),
      true};
}

namespace {

using Verdict = StandstillInquiry::Verdict;

/// How long securing may take: enough for slow brakes, too.
constexpr Duration kSecureTimeout = std::chrono::seconds(5);
/// How long a drive that was lost at speed is left to its own watchdog before it is reset.
constexpr Duration kBlindBraking = std::chrono::seconds(2);

/// How long a drive that left its requests unanswered is asked once more before it counts as
/// absent: the last of those requests was sent before, and it may have been heard again since.
constexpr Duration kAskedOnceMore = std::chrono::milliseconds(100);

/// The bridge itself stood still for this long, so that it asks again whether wheels stand.
constexpr Duration kSuspended = std::chrono::milliseconds(200);

/// One and a half periods: each living drive's heartbeat falls into it.
Duration listening_time(const Cia402Config& config) {
  return std::chrono::milliseconds(config.drive_heartbeat_ms) * 3 / 2;
}

}  // namespace

void BringUp::begin() {
  begun_ = true;
  d_.nodes.begin_inquiry(d_.commanding);
  d_.commanding = d_.nodes.any_running();
  d_.axes.hold();
  d_.stage.enter(d_.nodes.any_heard() ? Stage::securing : Stage::listening);
}

void BringUp::tick(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  if (begun_) note_lost_nodes(now);
  begun_ = false;
  if (ticked_ && now - *ticked_ >= kSuspended) {
    for (Node& node : d_.nodes) node.begin_inquiry();
    if (d_.stage.stage() == Stage::configuring && !d_.nodes.any_reset()) {
      d_.stage.enter(Stage::securing);
    }
  }
  ticked_ = now;
  switch (d_.stage.stage()) {
    case Stage::listening:
      listen(now);
      break;
    case Stage::securing:
      secure(now, nmt, service);
      break;
    case Stage::configuring:
      configure(now, nmt, service);
      break;
    case Stage::beating:
      if (d_.heartbeat.beats() >= 2) start_nodes(now, nmt);
      break;
    case Stage::activating:
      activate(now, nmt);
      break;
    case Stage::settling:
      settle(now);
      break;
    default:
      break;
  }
}

void BringUp::note_lost_nodes(Instant now) {
  for (Node& node : d_.nodes) {
    node.lost = false;
    for (std::size_t i = 0; i < d_.axes.size(); ++i) {
      node.lost = node.lost || (d_.axes[i].node() == node.id && d_.axes.in_doubt(i, now));
    }
  }
}

void BringUp::listen(Instant now) {
  if (d_.nodes.any_heard() || d_.stage.elapsed(now) >= listening_time(d_.config)) {
    d_.stage.enter(Stage::securing);
  }
  d_.commanding = d_.nodes.any_running();
}

void BringUp::secure_again(std::uint8_t node) {
  d_.axes.doubt(node);
  d_.nodes.of(node).begin_inquiry(true);
  if (d_.stage.stage() == Stage::listening) d_.stage.enter(Stage::securing);
}

void BringUp::recall(Node& node, Instant now, std::vector<CanFrame>& nmt) {
  if (!node.may_be_stopped()) return;
  if (node.newest_recalled && now - *node.newest_recalled < Drives::kRecall) return;
  if (!node.recalled) node.recalled = now;
  node.newest_recalled = now;
  nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::pre_operational, node.id));
}

bool BringUp::has_been_recalled(const Node& node, Instant now) const {
  return node.recalled &&
         now - *node.recalled >= std::chrono::milliseconds(d_.config.sdo_timeout_ms);
}

void BringUp::secure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  d_.commanding = d_.commanding || d_.nodes.any_running();
  bool all_safe = d_.stage.elapsed(now) >= listening_time(d_.config);
  bool all_known = true;
  if (!d_.commanding) d_.axes.command_stop(now);
  for (Node& node : d_.nodes) {
    node.inquiry.tick(now, d_.axes.sdo_stop_words(), service);
    d_.axes.on_news(node.inquiry.take_news(), now);
    recall(node, now, nmt);
    all_safe = all_safe && may_be_reset(node, now);
    all_known = all_known && node.inquiry.verdict() != Verdict::unknown;
  }
  if (all_safe) {
    take_up_positions(now);
    begin_configuration(now);
  } else if (all_known && d_.stage.elapsed(now) >= kSecureTimeout) {
    d_.refuse(turning_text(now));
  }
}

void BringUp::take_up_positions(Instant now) {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Node& node = d_.nodes.of(d_.axes[i].node());
    if (!node.heard || node.inquiry.verdict() != Verdict::standing) continue;
    if (const auto position = node.inquiry.position(i)) d_.axes[i].take_up(*position, now);
  }
}

bool BringUp::may_be_reset(const Node& node, Instant now) const {
  // A fresh witness that turns outweighs whatever else is said, or not said.
  if (d_.axes.turning_of(node.id, now)) return false;
  switch (node.inquiry.verdict()) {
    case Verdict::standing:
      return d_.axes.believes_standstill(now) && d_.axes.can_have_stopped(node.id);
    case Verdict::unconfirmed:
      return d_.stage.elapsed(now) >= kSecureTimeout;
    case Verdict::unknown:
    case Verdict::turning:
      return false;
    case Verdict::silent:
      break;
  }
  if (!node.heard) {
    return has_been_recalled(node, now) && can_have_stopped(node) &&
           now - node.inquiry.silent_since().value_or(now) >= kAskedOnceMore &&
           (!node.lost || d_.stage.elapsed(now) >= kBlindBraking);
  }
  // It runs, so that its silence says nothing of its wheel: only its feedback does.
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    if (d_.axes[i].node() != node.id) continue;
    if (!d_.axes[i].fresh(now) || !d_.axes.released(i) || !d_.axes.stands(i, now)) return false;
  }
  return true;
}

bool BringUp::can_have_stopped(const Node& node) const {
  // A wheel that turned without power is stopped by no watchdog.
  return d_.axes.can_have_stopped(node.id) &&
         std::ranges::none_of(d_.axes, [&node](const Axis& axis) {
           return axis.node() == node.id && axis.turned() && is_power_off(axis.state());
         });
}

std::string BringUp::turning_text(Instant now) const {
  std::string all;
  for (const Node& node : d_.nodes) {
    if (may_be_reset(node, now)) continue;
    std::string name = node.name;
    if (!all.empty()) all += "; ";
    if (node.inquiry.verdict() == Verdict::silent && !d_.axes.turning_of(node.id, now)) {
      all += name +
             ": answers no SDO request, and no feedback says that its wheel stands: see that "
             "it does, then switch the drive off and on";
      continue;
    }
    double speed_radps = 0.0;
    if (const auto& wheel = node.inquiry.fastest()) {
      name = d_.axes[wheel->axis].name();
      speed_radps = wheel->speed_radps;
    }
    if (node.inquiry.verdict() != Verdict::turning) {
      for (const Axis& axis : d_.axes) {
        if (axis.node() == node.id) speed_radps = axis.fastest_radps(now).value_or(speed_radps);
      }
    }
    all += fmt::format("{}: still turns at {:.2f} m/s after {:g} s: check its brake and load", name,
                       speed_radps * d_.axes.wheel_radius_m(), to_seconds(kSecureTimeout));
  }
  return all + "; no drive is reset while its wheel may turn, the stop stays commanded";
}

void BringUp::begin_configuration(Instant now) {
  d_.commanding = false;
  d_.axes.begin(now);
  d_.nodes.begin_startup();
  d_.stage.enter(Stage::configuring);
}

void BringUp::configure(Instant now, std::vector<CanFrame>& nmt, std::vector<CanFrame>& service) {
  for (Node& node : d_.nodes) start_up(node, now, nmt, service);
  if (std::string refusals = d_.nodes.refusals(); !refusals.empty()) {
    d_.refuse(std::move(refusals));
  } else if (d_.nodes.started_up()) {
    d_.heartbeat.restart_count();
    d_.stage.enter(Stage::beating);
  }
}

void BringUp::start_up(Node& node, Instant now, std::vector<CanFrame>& nmt,
                       std::vector<CanFrame>& service) {
  const bool again = node.startup.wants_reset_again();
  if (again) {
    node.inquiry.tick(now, d_.axes.sdo_stop_words(), service);
    d_.axes.on_news(node.inquiry.take_news(), now);
    recall(node, now, nmt);
  }
  node.startup.tick(now, service, !again || may_be_reset(node, now));
  // Its wheel may have begun to turn since it was asked before the first reset.
  if (!again && node.startup.wants_reset_again()) node.begin_inquiry();
}

void BringUp::start_nodes(Instant now, std::vector<CanFrame>& nmt) {
  d_.nodes.forget_states();
  for (const Node& node : d_.nodes) {
    nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
  }
  nmt_start_at_ = now;
  d_.commanding = true;
  d_.axes.hold();
  d_.stage.enter(Stage::activating);
}

void BringUp::activate(Instant now, std::vector<CanFrame>& nmt) {
  const bool operational = d_.nodes.all_operational();
  if (operational && d_.axes.fresh(now)) {
    d_.stage.enter(Stage::settling);
    return;
  }
  if (d_.stage.elapsed(now) >= d_.step_timeout() + d_.heartbeat_timeout()) {
    d_.refuse(waiting_for(now) + (operational ? "" : ": check the CAN wiring"));
    return;
  }
  // The frame may have been lost.
  if (now - nmt_start_at_ >= d_.heartbeat_timeout()) {
    nmt_start_at_ = now;
    for (const Node& node : d_.nodes) {
      if (node.operational()) continue;
      nmt.push_back(canopen::nmt_frame(canopen::NmtCommand::start, node.id));
    }
  }
}

void BringUp::settle(Instant now) {
  bool ready = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (axis.age(now) >= d_.step_timeout()) {
      d_.refuse(d_.axes.feedback_text(i));
      return;
    }
    ready = ready && axis.fresh(now) && d_.axes.stands(i, now) && axis.confirmed_off();
  }
  if (!ready) return;
  d_.axes.release();
  d_.stage.enter(Stage::standby);
}

std::string BringUp::waiting_for(Instant now) const {
  switch (d_.stage.stage()) {
    case Stage::idle:
      return "not started";
    case Stage::listening:
      return "listening for drives that are running already";
    case Stage::securing:
      return d_.nodes.any_heard() ? "braking drives that are running already"
                                  : "asking the drives whether their wheels stand";
    case Stage::configuring:
      return d_.nodes.progress();
    case Stage::beating:
      return "letting the drives know the bridge's heartbeat";
    case Stage::activating:
      for (const Node& node : d_.nodes) {
        if (!node.operational()) return node.name + ": not operational after NMT start";
      }
      break;
    case Stage::clearing:
      return "resetting the drives' faults";
    default:
      break;
  }
  return not_settled(now);
}

std::string BringUp::not_settled(Instant now) const {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (!axis.fresh(now)) return d_.axes.feedback_text(i);
    if (!d_.axes.stands(i, now)) return axis.name() + ": waiting until its wheel stands";
    if (!axis.confirmed_off()) {
      return fmt::format("{}: in {}, waiting until its power stage is off", axis.name(),
                         canopen::to_string(axis.state()));
    }
  }
  return "checking that the wheels stand";
}

void Clearing::begin() {
  d_.stage.enter(Stage::clearing);
  edge_ = false;
}

std::uint16_t Clearing::controlword() const {
  return edge_ ? canopen::kControlFaultReset : canopen::kControlDisableVoltage;
}

std::optional<Fault> Clearing::tick(Instant now) {
  std::optional<std::size_t> faulty;
  bool ready = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    if (!axis.in_fault()) continue;
    faulty = faulty.value_or(i);
    ready = ready && axis.confirmed_state() == canopen::DriveState::fault &&
            (axis.controlword() & canopen::kControlFaultReset) == 0;
  }
  if (!faulty) {
    for (Axis& axis : d_.axes) axis.on_emergency(canopen::kEmcyReset);
    d_.stage.enter(Stage::settling);
  } else if (!edge_ && ready) {
    edge_ = true;
    d_.stage.restart(now);
  } else if (d_.stage.elapsed(now) >= d_.step_timeout()) {
    return fault_of_axis(d_.axes, *faulty, " cannot be reset");
  }
  return std::nullopt;
}

namespace {

using canopen::DriveState;

constexpr int kTop = 3;

/// How far a state is on the way to OperationEnabled; −1 if it is not on that way.
int height(std::optional<DriveState> state) {
  if (!state) return -1;
  switch (*state) {
    case DriveState::switch_on_disabled:
      return 0;
    case DriveState::ready_to_switch_on:
      return 1;
    case DriveState::switched_on:
      return 2;
    case DriveState::operation_enabled:
      return kTop;
    case DriveState::not_ready:
    case DriveState::quick_stop_active:
    case DriveState::fault_reaction:
    case DriveState::fault:
      break;
  }
  return -1;
}

}  // namespace

void Enabling::begin() {
  d_.stage.enter(Stage::verifying);
  for (Node& node : d_.nodes) node.read_back.begin(node.startup.confirmed());
}

std::optional<Fault> Enabling::tick(Instant now, std::vector<CanFrame>& service) {
  if (d_.stage.stage() == Stage::verifying) {
    if (auto fault = verify(now, service)) return fault;
  }
  return d_.stage.stage() == Stage::enabling ? climb(now) : std::nullopt;
}

std::optional<Fault> Enabling::verify(Instant now, std::vector<CanFrame>& service) {
  bool done = true;
  for (Node& node : d_.nodes) {
    node.read_back.tick(now, service);
    done = done && node.read_back.done();
    if (node.read_back.deviation().empty()) continue;
    return Fault{fmt::format("{}: {} before it was to be enabled: another tool changed it? Reset "
                             "configures the drives again",
                             node.name, node.read_back.deviation()),
                 true};
  }
  if (!done) return std::nullopt;
  d_.stage.enter(Stage::enabling);
  d_.stage.mark(now);
  climbed_ = {-1, -1};
  return std::nullopt;
}

std::optional<Fault> Enabling::climb(Instant now) {
  bool all_enabled = true;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    const Axis& axis = d_.axes[i];
    const int reached = height(axis.confirmed_state());
    if (d_.stage.elapsed(now) == Duration{0} || reached > climbed_[i]) {
      climbed_[i] = std::max(climbed_[i], reached);
      climbed_at_[i] = now;
    }
    if (reached == kTop && d_.axes.shows_velocity_mode(i)) continue;
    all_enabled = false;
    if (reached == kTop) {
      if (now - climbed_at_[i] < d_.feedback_timeout()) continue;
      return wrong_mode(axis);
    }
    const bool dropped = climbed_[i] == kTop;
    if (dropped || now - climbed_at_[i] >= d_.step_timeout()) {
      return Fault{fmt::format(
          "{}: {} {} after controlword 0x{:04X}{}: check its main supply, STO and enable inputs",
          axis.name(), dropped ? "fell back to" : "is still in", canopen::to_string(axis.state()),
          axis.controlword(), dropped ? "" : fmt::format(" for {} ms", d_.config.step_timeout_ms))};
    }
  }
  if (all_enabled) d_.stage.enter(Stage::enabled);
  return std::nullopt;
}

namespace {

constexpr Duration kStopTimeout = std::chrono::seconds(5);

}  // namespace

void Stopping::begin(StopKind kind) {
  d_.stage.enter(Stage::stopping);
  kind_ = kind;
  braking_ = true;
}

std::uint16_t Stopping::controlword(std::size_t i) const {
  return braking_ ? d_.axes.braking_controlword(i) : canopen::kControlDisableVoltage;
}

std::optional<Fault> Stopping::tick(Instant now) {
  if (braking_) {
    brake(now);
    return std::nullopt;
  }
  if (d_.axes.confirmed_off()) {
    d_.stage.enter(Stage::standby);
    d_.axes.release();
    return std::nullopt;
  }
  if (d_.stage.elapsed(now) < d_.step_timeout()) return std::nullopt;
  const Axis& axis = d_.axes[d_.axes[0].confirmed_off() ? 1 : 0];
  return Fault{fmt::format(
      "{}: is still in {} {} ms after the command to switch its power stage off: switch off its "
      "supply",
      axis.name(), canopen::to_string(axis.state()), d_.config.step_timeout_ms)};
}

void Stopping::brake(Instant now) {
  const bool first = d_.stage.elapsed(now) == Duration{0};
  const bool at_once = first && kind_ == StopKind::disable;
  // A quick stop is sent at least once.
  bool still = at_once || !first;
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    still = still && (at_once ? d_.axes.stands(i, now) : d_.axes.confirmed_standing(i, now));
  }
  if (still) {
    braking_ = false;
    d_.stage.restart(now);
    d_.stage.tell("");
  } else if (d_.stage.elapsed(now) >= kStopTimeout) {
    d_.stage.tell(overdue_text(now));
  }
}

std::string Stopping::overdue_text(Instant now) const {
  for (std::size_t i = 0; i < d_.axes.size(); ++i) {
    if (d_.axes.stands(i, now)) continue;
    if (!d_.axes[i].fresh(now)) return d_.axes.feedback_text(i) + "; stop stays commanded";
    return fmt::format(
        "{}: its wheel still turns {:g} s after the quick stop: check brake and "
        "load; stop stays commanded",
        d_.axes[i].name(), to_seconds(kStopTimeout));
  }
  return "";
}

}  // namespace tether::cia402

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
  const std::optional<ObjectRef> object = written_object(frame);
  if (!object || !cia402::is_vital(drives_.config, node, object->index)) return;
  ++counters_.intruder_writes;
  if (drives_.stage.stage() < Stage::configuring) return bring_up_.secure_again(node);
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
