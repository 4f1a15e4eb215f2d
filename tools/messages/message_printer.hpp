#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace tether {

/// A field of any of the project's LCM types; integers of all widths are widened.
using FieldValue = std::variant<std::int64_t, double, bool, std::string, std::vector<std::int64_t>,
                                std::vector<float>, std::vector<double>, std::vector<std::string>>;

/// One LCM type that tools can take apart.
struct MessageType {
  std::string name;                      ///< name in lcm-spy: "pose_t"
  std::int64_t fingerprint = 0;          ///< first bytes of its messages
  std::vector<std::string> field_names;  ///< in the order of the .lcm file
  std::vector<FieldValue> empty;         ///< fields of an empty message: the kind of each
  /// Values in the order of field_names; nothing if `bytes` are not exactly one such message.
  std::optional<std::vector<FieldValue>> (*decode)(std::span<const std::uint8_t> bytes) = nullptr;
};

/// All types of lcmtypes/.
const std::vector<MessageType>& message_types();

/// Null if it is not one of the project's.
const MessageType* find_message_type(std::int64_t fingerprint);

/// Content of a message, from its bytes alone. Never throws: messages come from the
/// network and from damaged files.
struct MessageContent {
  std::size_t size_bytes = 0;
  std::optional<std::int64_t> fingerprint;  ///< none if shorter than 8 bytes
  const MessageType* type = nullptr;        ///< null if unknown
  std::vector<FieldValue> values;           ///< empty if unknown or undecodable

  bool decoded() const { return !values.empty(); }
  /// The field of that name; null if not decoded, or without one.
  const FieldValue* find(std::string_view field_name) const;
  /// The integer field of that name, if decoded and it has one.
  std::optional<std::int64_t> integer(std::string_view field_name) const;
  /// The double of that name, in the same way.
  std::optional<double> real(std::string_view field_name) const;
};

MessageContent inspect_message(std::span<const std::uint8_t> bytes);

/// "pose_t"; "0x0123456789abcdef", the fingerprint, if unknown; "-" if there is none.
std::string type_label(const MessageContent& message);

/// One line: `CTRL/POSE pose_t utime=50000 seq=1 x_m=0.25 …`; numbers as short as they can be
/// without losing a bit, arrays in brackets, text safe for terminals.
std::string format_message(std::string_view channel, const MessageContent& message);

/// Comma-separated field names and values (RFC 4180 quoting; true and false are 1 and 0; an
/// array is one cell, its elements separated by semicolons).
std::string csv_names(const MessageType& type);
std::string csv_values(const std::vector<FieldValue>& values);

}  // namespace tether
