#include "can_bridge/cia402/profile.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/canopen/canopen.hpp"
#include "can_bridge/canopen/sdo_upload.hpp"
#include "can_bridge/cia402/startup.hpp"
#include "can_bridge/cia402/texts.hpp"
#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/vehicle_config.hpp"

namespace tether {
namespace {

using canopen::NmtState;
using cia402::Sender;

// A timer's tick may come a little early; one cycle too late would be worse.
constexpr Duration kBeatSlack = std::chrono::milliseconds(1);

/// Of two controlwords for one common object: the one that holds back more.
std::uint16_t more_cautious(std::uint16_t a, std::uint16_t b) {
  constexpr std::array kOrder{canopen::kControlQuickStop,      canopen::kControlFaultReset,
                              canopen::kControlDisableVoltage, canopen::kControlShutdown,
                              canopen::kControlSwitchOn,       canopen::kControlEnableOperation};
  return std::ranges::find(kOrder, a) < std::ranges::find(kOrder, b) ? a : b;
}

}  // namespace

std::unique_ptr<DriveProfile> Cia402Config::make_profile(const VehicleConfig& vehicle) const {
  return std::make_unique<Cia402Profile>(*this, vehicle.wheel_radius_m, vehicle.track_m);
}

Cia402Profile::Cia402Profile(const Cia402Config& config, double wheel_radius_m, double track_m)
    : config_(config),
      wheel_radius_m_(wheel_radius_m),
      track_m_(track_m),
      pdos_(config),
      axes_{cia402::Axis(config.axes[0], cia402::axis_name(config, 0),
                         std::chrono::milliseconds(config.feedback_timeout_ms),
                         config.standstill_radps),
            cia402::Axis(config.axes[1], cia402::axis_name(config, 1),
                         std::chrono::milliseconds(config.feedback_timeout_ms),
                         config.standstill_radps)} {
  for (const std::uint8_t id : config.nodes()) nodes_.emplace_back(config, id);
}

std::vector<CanFilter> Cia402Profile::filters() const {
  return cia402::drivetrain_filters(config_, pdos_);
}

void Cia402Profile::on_frame(const CanFrame& frame, Instant now) {
  if (frame.extended || frame.remote) return;
  const Sender sender = cia402::sender_of(frame.id, config_, pdos_);
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
      // Who reads does not command.
      if (!is_upload_request(frame)) on_intruder(frame.id, sender.kind);
      break;
    case Sender::Kind::sdo_response:
      on_sdo(frame, node_of(sender.node));
      break;
    case Sender::Kind::heartbeat:
      on_heartbeat(frame, node_of(sender.node), now);
      break;
    case Sender::Kind::emergency:
      on_emergency(frame, node_of(sender.node));
      break;
    case Sender::Kind::feedback:
      on_feedback(frame, node_of(sender.node), now);
      break;
  }
}

Cia402Profile::Node& Cia402Profile::node_of(std::uint8_t id) {
  return id == nodes_.front().id ? nodes_.front() : nodes_.back();
}

void Cia402Profile::on_intruder(std::uint32_t id, Sender::Kind kind) {
  ++counters_.intruder_frames;
  if (std::ranges::find(intruders_, id) == intruders_.end()) intruders_.push_back(id);
  if (kind == Sender::Kind::sdo_request) return;
  fault(fmt::format("another sender uses 0x{:03X}: only one master may command", id),
        kind == Sender::Kind::nmt);
}

void Cia402Profile::on_sdo(const CanFrame& frame, Node& node) {
  const bool expected =
      stage_ == Stage::securing ? node.inquiry.on_sdo(frame) : node.startup.on_sdo(frame);
  if (!expected) ++counters_.rejected_frames;
}

std::string Cia402Profile::intruder() const {
  std::string ids;
  for (const std::uint32_t id : intruders_) {
    ids += fmt::format("{}0x{:03X}", ids.empty() ? "" : ", ", id);
  }
  return ids.empty() ? ids : ids + " from another sender";
}

void Cia402Profile::on_heartbeat(const CanFrame& frame, Node& node, Instant now) {
  const auto state = static_cast<NmtState>(frame.data[0]);
  const bool known = state == NmtState::boot_up || state == NmtState::stopped ||
                     state == NmtState::operational || state == NmtState::pre_operational;
  if (frame.size != 1 || !known) {
    ++counters_.rejected_frames;
    return;
  }
  node.state = state;
  if (state == NmtState::boot_up) {
    on_boot_up(node);
    return;
  }
  node.heartbeat_stamp = now;
  node.heard = true;
  if (state == NmtState::operational) {
    node.running = true;
  } else if (supervised()) {
    fault(fmt::format("{}: left the operational state ({}): full start-up needed", node.name,
                      state == NmtState::stopped ? "stopped" : "pre-operational"),
          true);
  }
}

void Cia402Profile::on_boot_up(Node& node) {
  node.heard = node.running = false;
  for (cia402::Axis& axis : axes_) {
    if (axis.node() == node.id) axis.reanchor();
  }
  if (stage_ == Stage::configuring) {
    node.startup.on_boot_up();
  } else if (stage_ > Stage::configuring) {
    fault(fmt::format("{}: rebooted: full start-up needed; check its supply voltage", node.name),
          true);
  }
}

void Cia402Profile::on_emergency(const CanFrame& frame, Node& node) {
  if (frame.size != 8) {
    ++counters_.rejected_frames;
    return;
  }
  node.heard = true;
  const auto code = static_cast<std::uint16_t>(canopen::read_integer(frame.data.data(), 2, false));
  for (cia402::Axis& axis : axes_) {
    if (axis.node() == node.id) axis.on_emergency(code);
  }
  if (code != canopen::kEmcyReset && supervised()) {
    fault(fmt::format("{}: emergency {}: remove the cause, then reset", node.name,
                      cia402::error_text(code)),
          false);
  }
  tell_error_code();
}

void Cia402Profile::on_feedback(const CanFrame& frame, Node& node, Instant now) {
  const bool fits =
      cia402::PdoMap::unpack(*pdos_.tpdo(frame.id), frame,
                             [this, now](const cia402::PdoMap::Field& field, std::int64_t value) {
                               axes_[field.axis].receive(field, value, now);
                             });
  if (!fits) {
    ++counters_.rejected_frames;
    return;
  }
  node.heard = node.running = true;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (axes_[i].node() == node.id) check_axis(i);
  }
  tell_error_code();
}

void Cia402Profile::tick(Instant now, std::vector<CanFrame>& out) {
  if (stage_ == Stage::idle) return;
  const auto mark_entry = [this, now] {
    if (!stage_since_) stage_since_ = now;
  };
  mark_entry();
  watch(now);
  mark_entry();
  std::vector<CanFrame> nmt, service;
  advance(now, nmt, service);
  mark_entry();

  out.insert(out.end(), nmt.begin(), nmt.end());
  if (commanding_) send_setpoints(now, out);
  send_heartbeat(now, out);
  out.insert(out.end(), service.begin(), service.end());
}

void Cia402Profile::send_setpoints(Instant now, std::vector<CanFrame>& out) {
  std::array<std::uint16_t, 2> words{wanted_controlword(0, now), wanted_controlword(1, now)};
  if (axes_[0].node() == axes_[1].node() &&
      axes_[0].controlword_object() == axes_[1].controlword_object()) {
    words[0] = words[1] = more_cautious(words[0], words[1]);
  }
  const std::array<std::int64_t, 2> targets = target_velocities();
  std::array<cia402::Setpoint, 2> setpoints;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    axes_[i].command(words[i]);
    setpoints[i] = {words[i], targets[i]};
  }
  pdos_.pack(setpoints, out);
  if (config_.sync) out.push_back(CanFrame::make(canopen::kSync, {}));
}

void Cia402Profile::send_heartbeat(Instant now, std::vector<CanFrame>& out) {
  if (next_beat_ && now + kBeatSlack < *next_beat_) return;
  const Duration period = std::chrono::milliseconds(config_.heartbeat_ms);
  next_beat_ = now + period;
  out.push_back(canopen::heartbeat_frame(config_.master_node, NmtState::operational));
  ++beats_;
}

std::array<std::int64_t, 2> Cia402Profile::target_velocities() const {
  if (stage_ != Stage::enabled) return {};  // the only place that decides it
  const WheelSpeeds speeds = to_wheel_speeds(command_, track_m_);
  const std::array units{axes_[0].target_units(speeds.left_mps / wheel_radius_m_),
                         axes_[1].target_units(speeds.right_mps / wheel_radius_m_)};
  double scale = 1.0;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const auto largest = static_cast<double>(axes_[i].largest_target());
    if (std::abs(units[i]) > largest) scale = std::min(scale, largest / std::abs(units[i]));
  }
  return {std::llround(units[0] * scale), std::llround(units[1] * scale)};
}

void Cia402Profile::set_command(const Twist& twist) {
  command_ = is_usable(twist) ? twist : Twist{};
}

DrivetrainSnapshot Cia402Profile::snapshot(Instant now) const {
  DrivetrainSnapshot result;
  result.phase = phase();
  result.reason = result.phase == DrivePhase::starting ? waiting_for(now) : reason_;
  for (std::size_t i = 0; i < axes_.size(); ++i) result.wheels[i] = axes_[i].feedback();
  result.feedback_fresh = axes_[0].fresh(now) && axes_[1].fresh(now);
  result.standstill = result.feedback_fresh && axes_[0].standing(now) && axes_[1].standing(now);
  return result;
}

std::vector<std::string> Cia402Profile::notes() const {
  std::vector<std::string> all;
  for (const Node& node : nodes_) {
    all.insert(all.end(), node.startup.notes().begin(), node.startup.notes().end());
  }
  return all;
}

}  // namespace tether
