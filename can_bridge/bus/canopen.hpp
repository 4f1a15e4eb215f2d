#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "can_bridge/bus/can_frame.hpp"
#include "can_bridge/bus/object_ref.hpp"

/// The parts of CANopen (CiA 301) and its drive profile (CiA 402) that both ends of the bus share:
/// identifiers, encodings, names.
namespace tether::canopen {

// Predefined connection set (CiA 301, 7.3.3); add the node id.
inline constexpr std::uint32_t kNmt = 0x000;
inline constexpr std::uint32_t kSync = 0x080;
inline constexpr std::uint32_t kEmcy = 0x080;
inline constexpr std::uint32_t kSdoResponse = 0x580;
inline constexpr std::uint32_t kSdoRequest = 0x600;
inline constexpr std::uint32_t kHeartbeat = 0x700;
/// COB-ID of TPDO or RPDO `number` (1…4) of a node.
constexpr std::uint32_t pdo_id(bool transmit, int number, std::uint8_t node) {
  return (transmit ? 0x080u : 0x100u) + 0x100u * static_cast<std::uint32_t>(number) + node;
}

/// Whether an object describes a PDO: its communication or its mapping (CiA 301, 7.5.2.35 to
/// 7.5.2.38).
constexpr bool is_pdo_parameter(std::uint16_t index) { return index >= 0x1400 && index < 0x1C00; }

enum class NmtCommand : std::uint8_t {
  start = 0x01,
  stop = 0x02,
  pre_operational = 0x80,
  reset_node = 0x81,
  reset_communication = 0x82,
};
enum class NmtState : std::uint8_t {
  boot_up = 0x00,
  stopped = 0x04,
  operational = 0x05,
  pre_operational = 0x7F,
};

/// node 0: all nodes.
CanFrame nmt_frame(NmtCommand command, std::uint8_t node);
CanFrame heartbeat_frame(std::uint8_t node, NmtState state);

/// Little-endian integers, as everywhere in CANopen.
std::int64_t read_integer(const std::uint8_t* bytes, std::uint8_t size, bool is_signed);
void write_integer(std::uint8_t* bytes, std::uint8_t size, std::int64_t value);

/// SDO abort codes (CiA 301, table 22).
enum class Abort : std::uint32_t {
  timeout = 0x05040000,
  unknown_command = 0x05040001,
  unsupported_access = 0x06010000,
  write_only = 0x06010001,
  read_only = 0x06010002,
  no_object = 0x06020000,
  cannot_map = 0x06040041,
  pdo_too_long = 0x06040042,
  wrong_length = 0x06070010,
  no_subindex = 0x06090011,
  invalid_value = 0x06090030,
  general = 0x08000000,
  device_state = 0x08000022,
};
/// "0x06020000 (no such object)"; unknown codes too.
std::string abort_text(std::uint32_t code);

/// An expedited SDO transfer's frames (CiA 301, 7.2.4.3).
CanFrame sdo_download(std::uint8_t node, const ObjectRef& object, std::int64_t value);
CanFrame sdo_upload(std::uint8_t node, const ObjectRef& object);
CanFrame sdo_abort(std::uint32_t id, const ObjectRef& object, std::uint32_t code);

// CiA 402 state machine (IEC 61800-7-201).
enum class DriveState : std::uint8_t {
  not_ready,
  switch_on_disabled,
  ready_to_switch_on,
  switched_on,
  operation_enabled,
  quick_stop_active,
  fault_reaction,
  fault,
};
/// nullopt for a statusword that matches no state.
std::optional<DriveState> drive_state(std::uint16_t statusword);
/// "OperationEnabled" …, as tools name them; "unknown" for nullopt.
const char* to_string(std::optional<DriveState> state);

inline constexpr std::uint16_t kControlShutdown = 0x0006;
inline constexpr std::uint16_t kControlSwitchOn = 0x0007;
inline constexpr std::uint16_t kControlEnableOperation = 0x000F;
inline constexpr std::uint16_t kControlDisableVoltage = 0x0000;
inline constexpr std::uint16_t kControlQuickStop = 0x0002;
inline constexpr std::uint16_t kControlFaultReset = 0x0080;  ///< acts on its rising edge
inline constexpr std::uint16_t kControlHalt = 0x0100;

// EMCY error codes (CiA 301, table 26).
inline constexpr std::uint16_t kEmcyReset = 0x0000;
inline constexpr std::uint16_t kEmcyHeartbeat = 0x8130;
inline constexpr std::uint16_t kEmcyPdoLength = 0x8210;
inline constexpr std::uint16_t kEmcyRpdoTimeout = 0x8250;

}  // namespace tether::canopen
