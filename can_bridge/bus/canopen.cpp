#include "can_bridge/bus/canopen.hpp"

#include <fmt/format.h>

#include <array>
#include <cassert>

namespace tether::canopen {
namespace {

CanFrame sdo_frame(std::uint32_t id, std::uint8_t command, const ObjectRef& object,
                   std::uint32_t data) {
  CanFrame frame =
      CanFrame::make(id, {command, static_cast<std::uint8_t>(object.index & 0xFF),
                          static_cast<std::uint8_t>(object.index >> 8), object.sub, 0, 0, 0, 0});
  write_integer(frame.data.data() + 4, 4, data);
  return frame;
}

}  // namespace

CanFrame nmt_frame(NmtCommand command, std::uint8_t node) {
  return CanFrame::make(kNmt, {static_cast<std::uint8_t>(command), node});
}

CanFrame heartbeat_frame(std::uint8_t node, NmtState state) {
  return CanFrame::make(kHeartbeat + node, {static_cast<std::uint8_t>(state)});
}

std::int64_t read_integer(const std::uint8_t* bytes, std::uint8_t size, bool is_signed) {
  assert(size >= 1 && size <= 4);
  std::uint32_t raw = 0;
  for (int i = size - 1; i >= 0; --i) raw = raw << 8 | bytes[i];
  const std::int64_t value = raw;
  const std::int64_t range = std::int64_t{1} << (8 * size);
  return is_signed && value >= range / 2 ? value - range : value;
}

void write_integer(std::uint8_t* bytes, std::uint8_t size, std::int64_t value) {
  auto raw = static_cast<std::uint64_t>(value);
  for (int i = 0; i < size; ++i, raw >>= 8) bytes[i] = static_cast<std::uint8_t>(raw & 0xFF);
}

std::string abort_text(std::uint32_t code) {
  const char* meaning = "vendor's own";
  switch (static_cast<Abort>(code)) {
    case Abort::timeout:
      meaning = "SDO timeout";
      break;
    case Abort::unknown_command:
      meaning = "unknown SDO command";
      break;
    case Abort::unsupported_access:
      meaning = "access not supported";
      break;
    case Abort::write_only:
      meaning = "write-only object";
      break;
    case Abort::read_only:
      meaning = "read-only object";
      break;
    case Abort::no_object:
      meaning = "no such object";
      break;
    case Abort::cannot_map:
      meaning = "object cannot be mapped to a PDO";
      break;
    case Abort::pdo_too_long:
      meaning = "mapped objects exceed the PDO's length";
      break;
    case Abort::wrong_length:
      meaning = "wrong data length";
      break;
    case Abort::no_subindex:
      meaning = "no such subindex";
      break;
    case Abort::invalid_value:
      meaning = "value out of range";
      break;
    case Abort::general:
      meaning = "general error";
      break;
    case Abort::device_state:
      meaning = "not possible in the present device state";
      break;
  }
  return fmt::format("0x{:08X} ({})", code, meaning);
}

CanFrame sdo_download(std::uint8_t node, const ObjectRef& object, std::int64_t value) {
  assert(object.bytes >= 1 && object.bytes <= 4);
  const auto unused = static_cast<std::uint8_t>(4 - object.bytes);
  CanFrame frame =
      sdo_frame(kSdoRequest + node, static_cast<std::uint8_t>(0x23 | unused << 2), object, 0);
  write_integer(frame.data.data() + 4, object.bytes, value);
  return frame;
}

CanFrame sdo_upload(std::uint8_t node, const ObjectRef& object) {
  return sdo_frame(kSdoRequest + node, 0x40, object, 0);
}

CanFrame sdo_abort(std::uint32_t id, const ObjectRef& object, std::uint32_t code) {
  return sdo_frame(id, 0x80, object, code);
}

std::optional<DriveState> drive_state(std::uint16_t statusword) {
  struct Pattern {
    std::uint16_t mask, value;
    DriveState state;
  };
  static constexpr std::array<Pattern, 8> kPatterns{{
      {0x4F, 0x00, DriveState::not_ready},
      {0x4F, 0x40, DriveState::switch_on_disabled},
      {0x6F, 0x21, DriveState::ready_to_switch_on},
      {0x6F, 0x23, DriveState::switched_on},
      {0x6F, 0x27, DriveState::operation_enabled},
      {0x6F, 0x07, DriveState::quick_stop_active},
      {0x4F, 0x0F, DriveState::fault_reaction},
      {0x4F, 0x08, DriveState::fault},
  }};
  for (const Pattern& p : kPatterns) {
    if ((statusword & p.mask) == p.value) return p.state;
  }
  return std::nullopt;
}

const char* to_string(std::optional<DriveState> state) {
  if (!state) return "unknown";
  switch (*state) {
    case DriveState::not_ready:
      return "NotReadyToSwitchOn";
    case DriveState::switch_on_disabled:
      return "SwitchOnDisabled";
    case DriveState::ready_to_switch_on:
      return "ReadyToSwitchOn";
    case DriveState::switched_on:
      return "SwitchedOn";
    case DriveState::operation_enabled:
      return "OperationEnabled";
    case DriveState::quick_stop_active:
      return "QuickStopActive";
    case DriveState::fault_reaction:
      return "FaultReactionActive";
    case DriveState::fault:
      return "Fault";
  }
  return "unknown";
}

}  // namespace tether::canopen
