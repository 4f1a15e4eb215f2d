#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tools/messages/message_printer.hpp"

namespace tether {

/// One constant of an LCM type.
struct ConstantNote {
  std::string name;
  std::int64_t value = 0;
  std::string meaning;
};

/// Note on a field in the .lcm file.
struct FieldNote {
  std::string meaning;                  ///< its comment; may be empty
  std::string unit;                     ///< unit by its name's ending: "m/s"; empty if it has none
  std::vector<ConstantNote> constants;  ///< if the comment says "one of the constants"
};

std::string message_note(const MessageType& type);  ///< the comment above the struct
/// In the order of type.field_names.
std::vector<FieldNote> field_notes(const MessageType& type);

/// SI's symbol for how a name ends: "m/s" for v_mps, "µs" for utime; empty if it has no unit.
std::string unit_of(std::string_view field_name);

/// "tether.pose_t".
std::string schema_name(const MessageType& type);

/// JSON Schema of the output of message_json(). Each property has "type" and
/// "description", which ends with its unit in brackets, and "unit" (a keyword of ours, as schemas
/// may have; readers ignore those that they do not know). Encoding "jsonschema" in MCAP and in
/// Foxglove's WebSocket protocol. One line of text; the same text for the same type, always.
std::string json_schema(const MessageType& type);

}  // namespace tether
