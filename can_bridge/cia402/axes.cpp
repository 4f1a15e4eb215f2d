#include "can_bridge/cia402/axes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "can_bridge/cia402/config.hpp"
#include "can_bridge/cia402/startup.hpp"
#include "can_bridge/cia402/stop_objects.hpp"
#include "common/vehicle/diff_drive.hpp"

namespace tether::cia402 {

void SenderCount::on_sync() {
  if (syncs_++ % every_ == 0) permits_ = std::min(permits_ + 1, kBacklog);
}

bool SenderCount::on_frame() {
  if (permits_ > 0) {
    --permits_;
    return true;
  }
  std::rotate(too_many_.begin(), too_many_.begin() + 1, too_many_.end());
  too_many_.back() = syncs_;
  return false;
}

bool SenderCount::two_sources() const {
  return too_many_.front() && syncs_ - *too_many_.front() < kWindow;
}

namespace {

using canopen::DriveState;

/// 50 revolutions a second: no vehicle's wheel turns faster.
constexpr double kFastestWheel_radps = 314.0;
/// How much later than the bridge commands it drives may begin to brake.
constexpr Duration kDrivesLag = std::chrono::milliseconds(60);

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
    : shares_controlword_(config.axes[0].node == config.axes[1].node &&
                          config.axes[0].controlword == config.axes[1].controlword),
      stops_by_setpoint_(config.stops_by_setpoint),
      by_setpoint_{config.stops_by_setpoint, config.stops_by_setpoint},
      standstill_radps_(config.standstill_radps),
      ramps_radps2_{stop_ramp_radps2(config, 0), stop_ramp_radps2(config, 1)},
      fastest_report_radps_(kFastestWheel_radps),
      wheel_radius_m_(wheel_radius_m),
      track_m_(track_m),
      feedback_timeout_ms_(config.feedback_timeout_ms),
      pdos_(config),
      axes_{axis_of(config, 0), axis_of(config, 1)},
      tells_mode_{config.tells_mode(config.axes[0]), config.tells_mode(config.axes[1])} {
  constexpr int kSlowest = 240;  // largest of the synchronous transmission types
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
    in_doubt_unheard_[i] = in_doubt(i, now);
    axes_[i].begin();
  }
  possible_radps_ = targets_radps_ = {};
  rolled_out_ = {true, true};
  by_setpoint_ = {stops_by_setpoint_, stops_by_setpoint_};
  misfits_.clear();
}

void Axes::on_news(const StandstillInquiry::News& news, Instant now) {
  for (const auto& [field, value] : news) {
    if (field.signal == Signal::actual_position) {
      axes_[field.axis].see_position(value, now);
    } else {
      axes_[field.axis].receive(field, value, now);
    }
  }
}

bool Axes::in_doubt(std::size_t i, Instant now) const {
  const Axis& axis = axes_[i];
  if (!axis.known()) return in_doubt_unheard_[i];
  return !is_power_off(axis.confirmed_state()) || !axis.stood() || !has_rolled_out(i) ||
         !believes_standstill(now);
}

bool Axes::confirmed_standing(std::size_t i, Instant now) const {
  return axes_[i].confirmed_standing(now) && has_rolled_out(i) && believes_standstill(now);
}

bool Axes::turning_of(std::uint8_t node, Instant now) const {
  return std::ranges::any_of(
      axes_, [&](const Axis& axis) { return axis.node() == node && axis.turning(now); });
}

bool Axes::can_have_stopped(std::uint8_t node) const {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (axes_[i].node() == node && !has_rolled_out(i)) return false;
  }
  return true;
}

void Axes::require_deceleration(double radps2) {
  for (double& ramp_radps2 : ramps_radps2_) ramp_radps2 = std::max(ramp_radps2, radps2);
}

void Axes::bound_speeds(Instant now, const std::array<std::int64_t, 2>& targets) {
  // While the bridge was held up it did not brake.
  const double dt_s = to_seconds(std::min<Duration>(now - bounded_at_.value_or(now), kDrivesLag));
  bounded_at_ = now;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    double& possible_radps = possible_radps_[i];
    const double slower_radps =
        std::isinf(ramps_radps2_[i]) ? 0.0 : possible_radps - ramps_radps2_[i] * dt_s;
    // A bridge that was held up has sent no stop meanwhile: the wheel followed what came before.
    const double followed_radps = targets_radps_[i];
    targets_radps_[i] =
        static_cast<double>(std::abs(targets[i])) / std::abs(axes_[i].target_units(1.0));
    const double reported_radps = std::abs(axes_[i].reported_radps(now).value_or(0.0));
    possible_radps = std::max({0.0, slower_radps, followed_radps, targets_radps_[i],
                               std::min(reported_radps, fastest_report_radps_)});
    if (possible_radps >= standstill_radps_) rolls_until_[i] = now + kDrivesLag;
    rolled_out_[i] = now >= rolls_until_[i];
  }
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

std::uint16_t Axes::braking_controlword(std::size_t i) const {
  const std::optional<DriveState> state = axes_[i].state();
  const bool takes_setpoints =
      state == DriveState::operation_enabled || state == DriveState::quick_stop_active;
  return by_setpoint_[i] && takes_setpoints ? canopen::kControlEnableOperation
                                            : canopen::kControlQuickStop;
}

std::uint16_t Axes::stop_controlword(std::size_t i, Instant now) {
  const Axis& axis = axes_[i];
  if (!released_[i] && (is_stop(axis.controlword()) || by_setpoint_[i])) {
    released_[i] = axis.confirmed_off() || axis.confirmed_state() == DriveState::not_ready ||
                   axis.confirmed_state() == DriveState::fault || confirmed_standing(i, now);
  }
  // Another sender may have switched it on again.
  if (released_[i] && axis.state() && !is_power_off(axis.state()) && axis.turning(now)) {
    released_[i] = false;
  }
  const bool off = shares_controlword_ ? released_[0] && released_[1] : released_[i];
  return off ? canopen::kControlDisableVoltage : braking_controlword(i);
}

void Axes::doubt(std::uint8_t node) {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    if (axes_[i].node() != node) continue;
    axes_[i].doubt();
    released_[i] = false;
    in_doubt_unheard_[i] = true;
  }
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
  if (shares_controlword_) {
    words[0] = words[1] = more_cautious(words[0], words[1]);
  }
  for (std::size_t i = 0; i < axes_.size(); ++i) axes_[i].command(words[i]);
  return words;
}

std::array<std::uint16_t, 2> Axes::command_stop(Instant now) {
  return command({stop_controlword(0, now), stop_controlword(1, now)});
}

std::array<std::uint16_t, 2> Axes::sdo_stop_words() const {
  std::array words{axes_[0].controlword(), axes_[1].controlword()};
  for (std::uint16_t& word : words) {
    if (!is_stop(word)) word = canopen::kControlQuickStop;
  }
  return words;
}

void Axes::send(std::array<std::uint16_t, 2> words, const std::array<std::int64_t, 2>& targets,
                std::vector<CanFrame>& out) {
  words = command(words);
  pdos_.pack({Setpoint{words[0], targets[0]}, Setpoint{words[1], targets[1]}}, out);
}

}  // namespace tether::cia402
