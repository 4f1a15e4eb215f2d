#include "can_bridge/agilex/v2.hpp"

#include <array>
#include <cmath>

namespace tether::agilex {
namespace {

using Bytes = std::array<std::uint8_t, 8>;

void put16(Bytes& bytes, std::size_t at, int value) {
  const auto raw = static_cast<std::uint16_t>(value);
  bytes.at(at) = static_cast<std::uint8_t>(raw >> 8);
  bytes.at(at + 1) = static_cast<std::uint8_t>(raw & 0xFF);
}

void put32(Bytes& bytes, std::size_t at, std::int32_t value) {
  const auto raw = static_cast<std::uint32_t>(value);
  put16(bytes, at, static_cast<int>(raw >> 16));
  put16(bytes, at + 2, static_cast<int>(raw & 0xFFFF));
}

std::uint16_t u16(const CanFrame& frame, std::size_t at) {
  return static_cast<std::uint16_t>(frame.data.at(at) << 8 | frame.data.at(at + 1));
}
std::int16_t i16(const CanFrame& frame, std::size_t at) {
  return static_cast<std::int16_t>(u16(frame, at));
}
std::int32_t i32(const CanFrame& frame, std::size_t at) {
  const std::uint32_t high = u16(frame, at);
  return static_cast<std::int32_t>(high << 16 | u16(frame, at + 2));
}

}  // namespace

CanFrame encode(const SystemState& state) {
  Bytes bytes{static_cast<std::uint8_t>(state.condition), static_cast<std::uint8_t>(state.mode)};
  put16(bytes, 2, static_cast<int>(std::lround(state.battery_V * 10.0)));
  put16(bytes, 4, state.error_code);
  bytes[7] = state.count;
  return CanFrame::make(kSystemState, bytes);
}

CanFrame encode(std::uint32_t id, const Motion& motion) {
  Bytes bytes{};
  put16(bytes, 0, motion.v_mmps);
  put16(bytes, 2, motion.omega_mradps);
  return CanFrame::make(id, bytes);
}

CanFrame encode(std::uint32_t id, const MotorState& motor) {
  Bytes bytes{};
  put16(bytes, 0, motor.speed_rpm);
  put16(bytes, 2, motor.current_dA);
  put32(bytes, 4, motor.pulses);
  return CanFrame::make(id, bytes);
}

CanFrame encode(const Odometry& odometry) {
  Bytes bytes{};
  put32(bytes, 0, odometry.left_mm);
  put32(bytes, 4, odometry.right_mm);
  return CanFrame::make(kOdometry, bytes);
}

CanFrame mode_frame(Mode mode) {
  return CanFrame::make(kModeCommand, Bytes{static_cast<std::uint8_t>(mode)});
}

CanFrame clear_frame() { return CanFrame::make(kClearCommand, Bytes{}); }

std::optional<SystemState> decode_system_state(const CanFrame& frame) {
  if (frame.size != 8 || frame.data[0] > 2 || frame.data[1] > 3) return std::nullopt;
  return SystemState{static_cast<Condition>(frame.data[0]), static_cast<Mode>(frame.data[1]),
                     u16(frame, 2) / 10.0, u16(frame, 4), frame.data[7]};
}

std::optional<Motion> decode_motion(const CanFrame& frame) {
  if (frame.size != 8) return std::nullopt;
  return Motion{i16(frame, 0), i16(frame, 2)};
}

std::optional<MotorState> decode_motor(const CanFrame& frame) {
  if (frame.size != 8) return std::nullopt;
  return MotorState{i16(frame, 0), i16(frame, 2), i32(frame, 4)};
}

std::optional<Odometry> decode_odometry(const CanFrame& frame) {
  if (frame.size != 8) return std::nullopt;
  return Odometry{i32(frame, 0), i32(frame, 4)};
}

}  // namespace tether::agilex
