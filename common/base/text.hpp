#pragma once

#include <charconv>
#include <optional>
#include <string_view>

namespace tether {

/// Without the blanks at both ends (space, tab, carriage return).
constexpr std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const auto begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

/// `text`, all of it, as a number in decimal digits; nothing if it is none, or one out of range.
/// "nan" and "inf" are doubles.
template <class Number>
std::optional<Number> to_number(std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace tether
