#include "can_bridge/cia402/profile/axes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/cia402/startup.hpp"
#include "can_bridge/cia402/texts.hpp"
#include "common/vehicle/diff_drive.hpp"

namespace tether::cia402 {
namespace {

using canopen::DriveState;

/// The more cautious of two controlwords for one common object.
std::uint16_t more_cautious(std::uint16_t a, std::uint16_t b) {
  constexpr std::array kOrder{canopen::kControlQuickStop,      canopen::kControlFaultReset,
                              canopen::kControlDisableVoltage, canopen::kControlShutdown,
                              canopen::kControlSwitchOn,       canopen::kControlEnableOperation};
  return std::ranges::find(kOrder, a) < std::ranges::find(kOrder, b) ? a : b;
}

bool is_stop(std::uint16_t controlword) {
  return controlword == canopen::kControlQuickStop ||
         controlword == canopen::kControlDisableVoltage;
}

Axis axis_of(const Cia402Config& config, std::size_t i) {
  return {config.axes[i], axis_name(config, i),
          std::chrono::milliseconds(config.feedback_timeout_ms), config.standstill_radps};
}

}  // namespace

Axes::Axes(const Cia402Config& config, double wheel_radius_m, double track_m)
    : wheel_radius_m_(wheel_radius_m),
      track_m_(track_m),
      feedback_timeout_ms_(config.feedback_timeout_ms),
      pdos_(config),
      axes_{axis_of(config, 0), axis_of(config, 1)},
      tells_mode_{config.tells_mode(config.axes[0]), config.tells_mode(config.axes[1])} {
  constexpr int kSlowest = 240;  // of the synchronous transmission types
  for (const PdoConfig& pdo : config.pdos) {
    if (!pdo.transmit || pdo.transmission > kSlowest || !config.sync) continue;
    senders_.emplace(canopen::pdo_id(true, pdo.number, pdo.node), SenderCount(pdo.transmission));
  }
}

void Axes::on_sync() {
  for (auto& [id, count] : senders_) count.on_sync();
}

bool Axes::count_sender(std::uint32_t id) {
  const auto found = senders_.find(id);
  return found == senders_.end() || found->second.on_frame();
}

bool Axes::two_sources(std::uint32_t id) const {
  const auto found = senders_.find(id);
  return found != senders_.end() && found->second.two_sources();
}

void Axes::restart_sender_count() {
  for (auto& [id, count] : senders_) count.reset();
}

void Axes::begin(Instant now) {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    was_in_doubt_[i] = in_doubt(i, now);
    axes_[i].begin();
  }
  misfits_.clear();
}

void Axes::on_news(const StandstillInquiry::News& news, Instant now) {
  for (const auto& [field, value] : news) axes_[field.axis].receive(field, value, now);
}

bool Axes::in_doubt(std::size_t i, Instant now) const {
  const Axis& axis = axes_[i];
  if (!axis.known()) return was_in_doubt_[i];
  return !is_power_off(axis.confirmed_state()) || !axis.stood() || !believes_standstill(now);
}

bool Axes::on_feedback(const CanFrame& frame, Instant now) {
  const PdoMap::Pdo& pdo = *pdos_.tpdo(frame.id);
  const bool fits = PdoMap::unpack(pdo, frame, [&](const PdoMap::Field& field, std::int64_t value) {
    axes_[field.axis].receive(field, value, now);
  });
  if (fits) {
    misfits_.erase(frame.id);
  } else {
    misfits_[frame.id] = frame.size;
  }
  return fits;
}

bool Axes::shows_velocity_mode(std::size_t i) const {
  return !tells_mode_[i] || axes_[i].mode() == kProfileVelocity;
}

std::string Axes::feedback_text(std::size_t i) const {
  std::string ids;
  std::string misfits;
  for (const PdoMap::Pdo& pdo : pdos_.tpdos()) {
    if (std::ranges::none_of(pdo.fields, [i](const auto& field) { return field.axis == i; })) {
      continue;
    }
    ids += fmt::format("{}0x{:03X}", ids.empty() ? "" : ", ", pdo.id);
    if (const auto found = misfits_.find(pdo.id); found != misfits_.end()) {
      misfits += fmt::format("{}0x{:03X} has {} bytes instead of {}", misfits.empty() ? "" : ", ",
                             pdo.id, found->second, pdo.size);
    }
  }
  if (!misfits.empty()) {
    return fmt::format(
        "{}: its TPDOs do not have the length of the file's mapping: {}. Map what the drive sends; "
        "for a drive that pads its TPDOs to 8 bytes, map objects that fill them",
        axes_[i].name(), misfits);
  }
  return fmt::format("{}: feedback older than {} ms (TPDOs {}): check its supply and the CAN plug",
                     axes_[i].name(), feedback_timeout_ms_, ids);
}

std::uint16_t Axes::stop_controlword(std::size_t i, Instant now) {
  const Axis& axis = axes_[i];
  if (!released_[i] && is_stop(axis.controlword())) {
    released_[i] = axis.confirmed_off() || axis.confirmed_state() == DriveState::not_ready ||
                   axis.confirmed_state() == DriveState::fault ||
                   (axis.confirmed_standing(now) && believes_standstill(now));
  }
  return released_[i] ? canopen::kControlDisableVoltage : canopen::kControlQuickStop;
}

std::array<std::int64_t, 2> Axes::target_velocities(const Twist& twist) const {
  const WheelSpeeds speeds = to_wheel_speeds(twist, track_m_);
  const std::array units{axes_[0].target_units(speeds.left_mps / wheel_radius_m_),
                         axes_[1].target_units(speeds.right_mps / wheel_radius_m_)};
  double scale = 1.0;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const auto largest = static_cast<double>(axes_[i].largest_target());
    if (std::abs(units[i]) > largest) scale = std::min(scale, largest / std::abs(units[i]));
  }
  return {std::llround(units[0] * scale), std::llround(units[1] * scale)};
}

std::array<std::uint16_t, 2> Axes::command(std::array<std::uint16_t, 2> words) {
  if (axes_[0].node() == axes_[1].node() &&
      axes_[0].controlword_object() == axes_[1].controlword_object()) {
    words[0] = words[1] = more_cautious(words[0], words[1]);
  }
  for (std::size_t i = 0; i < axes_.size(); ++i) axes_[i].command(words[i]);
  return words;
}

std::array<std::uint16_t, 2> Axes::command_stop(Instant now) {
  return command({stop_controlword(0, now), stop_controlword(1, now)});
}

void Axes::send(std::array<std::uint16_t, 2> words, const std::array<std::int64_t, 2>& targets,
                std::vector<CanFrame>& out) {
  words = command(words);
  pdos_.pack({Setpoint{words[0], targets[0]}, Setpoint{words[1], targets[1]}}, out);
}

}  // namespace tether::cia402
