#pragma once

#include <cstdint>
#include <optional>

#include "can_bridge/bus/can_frame.hpp"

/// The AgileX protocol, version 2: identifiers, layouts, periods. 500 kbit/s, 11-bit identifiers,
/// 8 data bytes, big-endian.
///
/// Sources: AgileX Tracer user manual (V1.2), chapter "CAN interface protocol"; the layouts agree
/// with ugv_sdk's src/protocol_v2/agilex_protocol_v2.h.
namespace tether::agilex {

inline constexpr std::uint32_t kMotionCommand = 0x111;  ///< host → chassis, every 20 ms
inline constexpr std::uint32_t kSystemState = 0x211;    ///< chassis → host, every 20 ms, as below
inline constexpr std::uint32_t kMotionState = 0x221;
inline constexpr std::uint32_t kMotor1State = 0x251;  ///< left
inline constexpr std::uint32_t kMotor2State = 0x252;  ///< right
inline constexpr std::uint32_t kOdometry = 0x311;
inline constexpr std::uint32_t kModeCommand = 0x421;   ///< host → chassis, byte 0: Mode
inline constexpr std::uint32_t kClearCommand = 0x441;  ///< host → chassis, byte 0: 0 clears all

/// The chassis stops by itself when no motion command came for this long: its watchdog, which
/// cannot be set.
inline constexpr int kCommandTimeout_ms = 500;
inline constexpr int kPeriod_ms = 20;

enum class Condition : std::uint8_t { normal = 0, emergency_stop = 1, exception = 2 };
/// Tracer reports 2 for its remote control, Tracer Mini 3.
enum class Mode : std::uint8_t { standby = 0, can = 1, remote = 2, remote_mini = 3 };

/// 0x211.
struct SystemState {
  Condition condition = Condition::normal;
  Mode mode = Mode::standby;
  double battery_V = 0.0;        ///< steps of 0.1 V
  std::uint16_t error_code = 0;  ///< a bit a fault or warning; they differ between chassis
  std::uint8_t count = 0;        ///< counts frames
  bool operator==(const SystemState&) const = default;
};
/// 0x111 and 0x221: whole mm/s and mrad/s.
struct Motion {
  std::int16_t v_mmps = 0;
  std::int16_t omega_mradps = 0;
  bool operator==(const Motion&) const = default;
};
/// 0x251 and 0x252.
struct MotorState {
  std::int16_t speed_rpm = 0;
  std::int16_t current_dA = 0;
  std::int32_t pulses = 0;
  bool operator==(const MotorState&) const = default;
};
/// 0x311: way of each wheel's rim since power-on; wraps.
struct Odometry {
  std::int32_t left_mm = 0;
  std::int32_t right_mm = 0;
  bool operator==(const Odometry&) const = default;
};

CanFrame encode(const SystemState& state);
/// `id`: kMotionCommand or kMotionState.
CanFrame encode(std::uint32_t id, const Motion& motion);
/// `id`: kMotor1State or kMotor2State.
CanFrame encode(std::uint32_t id, const MotorState& motor);
CanFrame encode(const Odometry& odometry);
CanFrame mode_frame(Mode mode);
CanFrame clear_frame();

/// nullopt for a wrong length, or a condition or mode that the protocol does not have.
std::optional<SystemState> decode_system_state(const CanFrame& frame);
/// nullopt for a wrong length.
std::optional<Motion> decode_motion(const CanFrame& frame);
std::optional<MotorState> decode_motor(const CanFrame& frame);
std::optional<Odometry> decode_odometry(const CanFrame& frame);

}  // namespace tether::agilex
