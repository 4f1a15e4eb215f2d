#include "can_bridge/node/can_drive_node.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <set>
#include <string>
#include <tether/drive_fault_t.hpp>
#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>

#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/profiles/emulation.hpp"
#include "can_bridge/profiles/profiles.hpp"
#include "common/base/errors.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
namespace {

Instant first_instant(const DriveSettings& settings) {
  return kStart - from_seconds(settings.get<RunSettings>().lead_s);
}

std::int32_t kind_of(CanSettings::Inject inject) {
  using Inject = CanSettings::Inject;
  switch (inject) {
    case Inject::none:
      return drive_fault_t::NONE;
    case Inject::fault:
      return drive_fault_t::FAULT;
    case Inject::reboot:
      return drive_fault_t::REBOOT;
    case Inject::silence:
      return drive_fault_t::SILENCE;
    case Inject::sdo_abort:
      return drive_fault_t::SDO_ABORT;
    case Inject::encoder_freeze:
      return drive_fault_t::ENCODER_FREEZE;
    case Inject::wheel_slip:
      return drive_fault_t::WHEEL_SLIP;
    case Inject::safety_input:
      return drive_fault_t::SAFETY_INPUT;
  }
  return drive_fault_t::NONE;
}

void check_inject_node(std::int64_t node, const std::vector<std::uint8_t>& nodes) {
  if (node == 0 || std::find(nodes.begin(), nodes.end(), node) != nodes.end()) return;
  std::string allowed = "0 (all)";
  for (const int id : std::set<int>(nodes.begin(), nodes.end())) allowed += fmt::format(", {}", id);
  throw UsageError(fmt::format("can.inject_node = {}: the drivetrain has no such node; allowed: {}",
                               node, allowed));
}

bool is_usable(const WheelStates& wheels) {
  return std::all_of(wheels.angle_rad.begin(), wheels.angle_rad.end(),
                     [](double x) { return tether::is_usable(x); }) &&
         std::all_of(wheels.speed_radps.begin(), wheels.speed_radps.end(),
                     [](double x) { return tether::is_usable(x); });
}

}  // namespace

CanDriveNode::CanDriveNode(const DriveSettings& settings, const DrivetrainConfig& config,
                           EventLoop& loop, Bus& bus, CanPort& port)
    : loop_(loop),
      bus_(bus),
      port_(port),
      channels_(settings.get<VehicleSettings>().name),
      standalone_(settings.get<CanSettings>().wheels == CanSettings::Wheels::model),
      nodes_(drive_nodes(config)),
      drives_(make_emulated_drivetrain(config, std::max(loop.now(), first_instant(settings)))),
      inputs_(settings.get<CanSettings>().emulate_drives ? safety_inputs(config)
                                                         : std::vector<SafetyInputConfig>{}),
      wheel_models_{WheelModel(WheelModel::of(settings.get<VehicleSettings>())),
                    WheelModel(WheelModel::of(settings.get<VehicleSettings>()))},
      wheel_guard_({.earliest = first_instant(settings)}),
      fault_guard_({.earliest = first_instant(settings), .counts_up = false}),
      last_tick_(std::max(loop.now(), first_instant(settings))),
      counters_(loop, bus, "drive", channels_.drive_counters,
                from_seconds(settings.get<RunSettings>().report_period_s),
                [this](CounterList& out) { list_counters(out); }) {
  port_.on_frame(drives_->filters(), [this](const CanFrame& frame) { on_frame(frame); });
  subscribe_to_faults(settings);
  const Instant first = first_instant(settings);
  const Duration coupling = from_seconds(settings.get<VehicleSettings>().coupling_ms * 1e-3);
  const Duration tick_period = loop_.rate() > 0.0 ? kRealTimeTick : kTick;
  loop_.every(first, tick_period, Priority::delivery, [this](Instant) { tick(); });
  if (standalone_) {
    loop_.every(first, coupling, Priority::delivery, [this](Instant) { publish_wheels(); });
  } else {
    subscribe_to_wheels();
    loop_.every(first, coupling, Priority::delivery, [this](Instant) { publish_targets(); });
  }
}

void CanDriveNode::subscribe_to_faults(const DriveSettings& settings) {
  subscribe<drive_fault_t>(bus_, channels_.can_inject, kDeepQueue, faults_undecodable_,
                           [this](const drive_fault_t& m) {
                             if (!fault_guard_.accept(loop_.now(), from_utime(m.utime), m.seq)) {
                               return;
                             }
                             on_fault_request(m.node, m.kind, m.value);
                           });
  const CanSettings& can = settings.get<CanSettings>();
  if (can.inject == CanSettings::Inject::none) return;
  if (can.inject != CanSettings::Inject::safety_input) {
    check_inject_node(can.inject_node, nodes_);
  } else if (!inputs_.has(can.inject_node)) {
    throw UsageError(
        fmt::format("can.inject_node = {}: the drivetrain has no such safety input; they are "
                    "numbered from 1 on, 0 means all",
                    can.inject_node));
  }
  loop_.at(kStart + from_seconds(can.inject_at_s), Priority::delivery,
           [this, node = static_cast<std::int32_t>(can.inject_node), kind = kind_of(can.inject),
            value = can.inject_value](Instant) { on_fault_request(node, kind, value); });
}

void CanDriveNode::subscribe_to_wheels() {
  subscribe<wheel_states_t>(
      bus_, channels_.wheel_states, 1, wheels_undecodable_, [this](const wheel_states_t& m) {
        on_wheels(
            from_utime(m.utime), m.seq,
            {{m.left_angle_rad, m.right_angle_rad}, {m.left_speed_radps, m.right_speed_radps}});
      });
  drives_->set_wheels(wheels_);
}

void CanDriveNode::on_wheels(Instant stamp, std::int64_t seq, const WheelStates& wheels) {
  if (!is_usable(wheels)) {
    ++wheels_non_finite_;
    return;
  }
  if (!wheel_guard_.accept(loop_.now(), stamp, seq)) return;
  wheels_ = wheels;
  wheels_silent_ = false;
  last_wheels_ = loop_.now();
  drives_->set_wheels(wheels_);
}

void CanDriveNode::tick() {
  const Instant now = loop_.now();
  turn_wheels(now);
  drives_->tick(now, out_);
  inputs_.tick(now, out_);
  send_all();
}

void CanDriveNode::turn_wheels(Instant now) {
  if (!standalone_) {
    if (wheels_silent_ || now - last_wheels_ < kWheelTimeout) return;
    wheels_silent_ = true;
    ++wheel_timeouts_;
    wheels_.speed_radps = {};
    drives_->set_wheels(wheels_);
    return;
  }
  const std::array<double, 2> targets_radps = drives_->wheel_targets_radps();
  for (std::size_t i = 0; i < wheel_models_.size(); ++i) {
    wheel_models_[i].step(targets_radps[i], now - last_tick_);
    wheels_.angle_rad[i] = wheel_models_[i].angle_rad();
    wheels_.speed_radps[i] = wheel_models_[i].speed_radps();
  }
  last_tick_ = now;
  drives_->set_wheels(wheels_);
}

void CanDriveNode::publish_wheels() {
  wheel_states_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = wheels_seq_++;
  message.left_angle_rad = wheels_.angle_rad[0];
  message.right_angle_rad = wheels_.angle_rad[1];
  message.left_speed_radps = wheels_.speed_radps[0];
  message.right_speed_radps = wheels_.speed_radps[1];
  publish(bus_, channels_.wheel_states, message);
}

void CanDriveNode::publish_targets() {
  const std::array<double, 2> targets_radps = drives_->wheel_targets_radps();
  wheel_targets_t message{};
  message.utime = to_utime(loop_.now());
  message.seq = targets_seq_++;
  message.left_speed_radps = targets_radps[0];
  message.right_speed_radps = targets_radps[1];
  publish(bus_, channels_.wheel_targets, message);
}

void CanDriveNode::on_frame(const CanFrame& frame) {
  drives_->on_frame(frame, loop_.now(), out_);
  send_all();
}

void CanDriveNode::send_all() {
  // A frame that the bus does not take is lost, as in a real drive; the port counts it.
  sending_.swap(out_);
  for (const CanFrame& frame : sending_) port_.send(frame);
  sending_.clear();
}

void CanDriveNode::on_fault_request(std::int32_t node, std::int32_t kind, double value) {
  ++(apply(node, kind, value) ? faults_injected_ : faults_refused_);
}

bool CanDriveNode::apply(std::int32_t node, std::int32_t kind, double value) {
  if (!tether::is_usable(value)) return false;
  using Act = EmulatedSafetyInputs::Act;
  if (kind == drive_fault_t::SAFETY_INPUT) {
    const bool known = value == 0.0 || value == 1.0 || value == 2.0;
    if (!known || !inputs_.has(node)) return false;
    inputs_.set(node, static_cast<Act>(static_cast<int>(value)));
    return true;
  }
  const bool node_exists =
      node == 0 || std::find(nodes_.begin(), nodes_.end(), node) != nodes_.end();
  const bool kind_exists = kind >= drive_fault_t::NONE && kind <= drive_fault_t::WEAK_BRAKE;
  if (kind == drive_fault_t::NONE && inputs_.has(node)) {
    inputs_.set(node, Act::clear);
  } else if (!node_exists) {
    return false;
  }
  if (!kind_exists) return false;
  if (node_exists) drives_->inject({node, static_cast<DriveFault::Kind>(kind), value}, loop_.now());
  return true;
}

void CanDriveNode::finish() { counters_.publish_now(); }

void CanDriveNode::list_counters(CounterList& out) const {
  port_.list(out);
  drives_->list(out);
  if (!standalone_) {
    wheel_guard_.list("wheels", out);
    out.emplace_back("wheels.undecodable", wheels_undecodable_);
    out.emplace_back("wheels.non_finite", wheels_non_finite_);
    out.emplace_back("wheels.timeouts", wheel_timeouts_);
  }
  fault_guard_.list("inject", out);
  out.emplace_back("inject.undecodable", faults_undecodable_);
  out.emplace_back("inject.refused", faults_refused_);
  out.emplace_back("inject.applied", faults_injected_);
}

}  // namespace tether
