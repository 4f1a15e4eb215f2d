#include "can_bridge/cia402/standstill.hpp"

#include <cmath>
#include <numbers>

namespace tether::cia402 {
namespace {

using canopen::DriveState;

constexpr Duration kPoweredStandstill = std::chrono::milliseconds(500);

bool is_off(std::optional<DriveState> state) {
  return state == DriveState::not_ready || state == DriveState::switch_on_disabled ||
         state == DriveState::ready_to_switch_on || state == DriveState::fault;
}

}  // namespace

StandstillInquiry::StandstillInquiry(const Cia402Config& config, std::uint8_t node)
    : config_(config),
      sdo_(node, std::chrono::milliseconds(config.sdo_timeout_ms), config.sdo_retries) {
  for (std::size_t axis = 0; axis < config.axes.size(); ++axis) {
    if (config.axes[axis].node == node) readings_.push_back({axis, std::nullopt, true});
  }
}

void StandstillInquiry::begin() {
  sdo_.cancel();
  question_ = 0;
  verdict_ = Verdict::unknown;
  fastest_.reset();
  standing_since_.reset();
}

void StandstillInquiry::tick(Instant now, std::vector<CanFrame>& out) {
  if (const auto result = sdo_.take_result()) on_result(*result, now);
  if (!sdo_.busy()) ask();
  sdo_.tick(now, out);
  if (const auto result = sdo_.take_result()) on_result(*result, now);
}

void StandstillInquiry::ask() {
  const AxisConfig& axis = config_.axes[readings_[question_ / 2].axis];
  sdo_.read(question_ % 2 == 0 ? axis.statusword : axis.actual_velocity);
}

void StandstillInquiry::on_result(const SdoResult& result, Instant now) {
  if (result.outcome == SdoResult::Outcome::no_answer) {
    verdict_ = Verdict::silent;
    standing_since_.reset();
    question_ = 0;
    return;
  }
  const bool told = result.outcome == SdoResult::Outcome::done;
  Reading& reading = readings_[question_ / 2];
  const AxisConfig& axis = config_.axes[reading.axis];
  if (question_ % 2 == 0) {
    const auto word = static_cast<std::uint16_t>(result.value >> axis.statusword_shift & 0xFFFF);
    reading.power_off = !told || is_off(canopen::drive_state(word));
  } else {
    reading.speed_radps.reset();
    if (told) {
      reading.speed_radps = static_cast<double>(axis.sign * result.value) * 2.0 * std::numbers::pi /
                            axis.actual_velocity_per_rps.value();
    }
  }
  if (++question_ < 2 * readings_.size()) return;
  question_ = 0;
  judge(now);
}

void StandstillInquiry::judge(Instant now) {
  bool standing = true, power_off = true;
  fastest_.reset();
  for (const Reading& reading : readings_) {
    power_off = power_off && reading.power_off;
    if (!reading.speed_radps) continue;
    standing = standing && std::abs(*reading.speed_radps) < config_.standstill_radps;
    if (!fastest_ || std::abs(*reading.speed_radps) > std::abs(fastest_->speed_radps)) {
      fastest_ = Wheel{reading.axis, *reading.speed_radps};
    }
  }
  if (!standing) {
    standing_since_.reset();
  } else if (!standing_since_) {
    standing_since_ = now;
  }
  const bool long_enough = standing && (power_off || now - *standing_since_ >= kPoweredStandstill);
  verdict_ = long_enough ? Verdict::standing : Verdict::turning;
}

}  // namespace tether::cia402
