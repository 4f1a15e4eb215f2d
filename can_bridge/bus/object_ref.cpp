#include "can_bridge/bus/object_ref.hpp"

#include <fmt/format.h>

#include <charconv>

namespace tether {
namespace {

std::optional<unsigned> read_hex(std::string_view text, std::size_t max_digits) {
  unsigned value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  const bool whole = error == std::errc{} && end == text.data() + text.size();
  return whole && text.size() <= max_digits ? std::optional(value) : std::nullopt;
}

}  // namespace

std::optional<ObjectRef> parse_object(std::string_view text) {
  if (!text.starts_with("0x") && !text.starts_with("0X")) return std::nullopt;
  const auto colon = text.find(':');
  const auto space = text.find(' ');
  if (colon == std::string_view::npos || space == std::string_view::npos || space < colon) {
    return std::nullopt;
  }
  const auto index = read_hex(text.substr(2, colon - 2), 4);
  const auto sub = read_hex(text.substr(colon + 1, space - colon - 1), 2);
  const std::string_view type = text.substr(space + 1);
  if (!index || *index < 0x1000 || !sub || type.size() < 2) return std::nullopt;
  ObjectRef object{static_cast<std::uint16_t>(*index), static_cast<std::uint8_t>(*sub), 0,
                   type.front() == 'i'};
  if (type.front() != 'i' && type.front() != 'u') return std::nullopt;
  const std::string_view bits = type.substr(1);
  if (bits == "8") object.bytes = 1;
  if (bits == "16") object.bytes = 2;
  if (bits == "32") object.bytes = 4;
  return object.bytes == 0 ? std::nullopt : std::optional(object);
}

std::pair<std::int64_t, std::int64_t> object_limits(const ObjectRef& object) {
  const std::int64_t range = std::int64_t{1} << (8 * object.bytes);
  return object.is_signed ? std::pair(-range / 2, range / 2 - 1)
                          : std::pair(std::int64_t{0}, range - 1);
}

std::string to_string(const ObjectRef& object) {
  return fmt::format("0x{:04X}:{:02X} {}{}", object.index, object.sub, object.is_signed ? 'i' : 'u',
                     8 * object.bytes);
}

}  // namespace tether
