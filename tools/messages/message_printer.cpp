#include "tools/messages/message_printer.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <iomanip>
#include <iterator>
#include <sstream>
#include <tether/all_messages.hpp>
#include <type_traits>
#include <utility>

#include "common/base/text.hpp"
#include "common/node/message_io.hpp"

namespace tether {
namespace {

// LCM's booleans are int8_t in C++, and nothing else is.
template <class T>
FieldValue to_value(const T& x) {
  if constexpr (std::is_same_v<T, std::int8_t>) {
    return x != 0;
  } else if constexpr (std::is_integral_v<T>) {
    return std::int64_t{x};
  } else if constexpr (std::is_floating_point_v<T> || std::is_same_v<T, std::string>) {
    return x;
  } else {
    using Element = std::remove_cvref_t<decltype(x[0])>;
    using Shown = std::conditional_t<std::is_integral_v<Element>, std::int64_t, Element>;
    return std::vector<Shown>(std::begin(x), std::end(x));
  }
}

template <class LcmType>
std::optional<std::vector<FieldValue>> decode_values(std::span<const std::uint8_t> bytes) {
  LcmType message{};
  if (!decode(bytes, message)) return std::nullopt;
  std::vector<FieldValue> values;
  visit_fields(message,
               [&](const char*, const auto& x, auto...) { values.push_back(to_value(x)); });
  return values;
}

template <class LcmType>
MessageType describe() {
  MessageType type{LcmType::getTypeName(), LcmType::getHash(), {}, {}, &decode_values<LcmType>};
  LcmType message{};
  visit_fields(message, [&](const char* name, const auto& x, auto...) {
    type.field_names.push_back(name);
    type.empty.push_back(to_value(x));
  });
  return type;
}

template <class... LcmTypes>
struct Described {
  static std::vector<MessageType> types() { return {describe<LcmTypes>()...}; }
};

struct LineFormat {
  std::string operator()(std::int64_t x) const { return fmt::format("{}", x); }
  std::string operator()(double x) const { return fmt::format("{}", x); }
  std::string operator()(float x) const { return fmt::format("{}", x); }
  std::string operator()(bool x) const { return x ? "true" : "false"; }
  std::string operator()(const std::string& x) const { return printable(x); }
  template <class T>
  std::string operator()(const std::vector<T>& list) const {
    std::vector<std::string> parts;
    for (const T& x : list) parts.push_back((*this)(x));
    return fmt::format("[{}]", fmt::join(parts, ", "));
  }
};

struct CsvFormat {
  std::string operator()(std::int64_t x) const { return fmt::format("{}", x); }
  std::string operator()(double x) const { return fmt::format("{}", x); }
  std::string operator()(bool x) const { return x ? "1" : "0"; }
  std::string operator()(const std::string& x) const {
    if (x.find_first_of(",\"\r\n") == std::string::npos) return x;
    return (std::ostringstream() << std::quoted(x, '"', '"')).str();
  }
  template <class T>
  std::string operator()(const std::vector<T>& list) const {
    return (*this)(fmt::format("{}", fmt::join(list, ";")));
  }
};

}  // namespace

const std::vector<MessageType>& message_types() {
  static const auto kTypes = AllMessages<Described>::types();
  return kTypes;
}

const MessageType* find_message_type(std::int64_t fingerprint) {
  for (const MessageType& type : message_types()) {
    if (type.fingerprint == fingerprint) return &type;
  }
  return nullptr;
}

namespace {

template <class T>
std::optional<T> field(const MessageContent& message, std::string_view name) {
  const FieldValue* const found = message.find(name);
  const auto* const value = found == nullptr ? nullptr : std::get_if<T>(found);
  return value == nullptr ? std::nullopt : std::optional(*value);
}

}  // namespace

const FieldValue* MessageContent::find(std::string_view field_name) const {
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (type->field_names[i] == field_name) return &values[i];
  }
  return nullptr;
}

std::optional<std::int64_t> MessageContent::integer(std::string_view field_name) const {
  return field<std::int64_t>(*this, field_name);
}

std::optional<double> MessageContent::real(std::string_view field_name) const {
  return field<double>(*this, field_name);
}

MessageContent inspect_message(std::span<const std::uint8_t> bytes) {
  MessageContent content;
  content.size_bytes = bytes.size();
  if (bytes.size() < 8) return content;
  std::uint64_t fingerprint = 0;
  for (const std::uint8_t byte : bytes.first(8)) fingerprint = fingerprint << 8 | byte;
  content.fingerprint = static_cast<std::int64_t>(fingerprint);
  content.type = find_message_type(*content.fingerprint);
  if (content.type != nullptr) {
    if (auto values = content.type->decode(bytes)) content.values = std::move(*values);
  }
  return content;
}

std::string type_label(const MessageContent& message) {
  if (message.type != nullptr) return message.type->name;
  if (!message.fingerprint) return "-";
  return fmt::format("0x{:016x}", static_cast<std::uint64_t>(*message.fingerprint));
}

std::string format_message(std::string_view channel, const MessageContent& message) {
  std::string line = fmt::format("{} {}", printable(channel), type_label(message));
  if (!message.decoded()) {
    return line + fmt::format(" ({}, {} bytes)",
                              message.type != nullptr ? "undecodable" : "unknown type",
                              message.size_bytes);
  }
  for (std::size_t i = 0; i < message.values.size(); ++i) {
    line += fmt::format(" {}={}", message.type->field_names[i],
                        std::visit(LineFormat{}, message.values[i]));
  }
  return line;
}

std::string csv_names(const MessageType& type) {
  return fmt::format("{}", fmt::join(type.field_names, ","));
}

std::string csv_values(const std::vector<FieldValue>& values) {
  std::vector<std::string> cells;
  for (const FieldValue& value : values) cells.push_back(std::visit(CsvFormat{}, value));
  return fmt::format("{}", fmt::join(cells, ","));
}

}  // namespace tether
