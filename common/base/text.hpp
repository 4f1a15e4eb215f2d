#pragma once

#include <charconv>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace tether {

/// Texts before and after the single arrow of a text (-> or →), trimmed; nullopt if there is
/// none. Throws UsageError for two.
std::optional<std::pair<std::string, std::string>> split_at_arrow(const std::string& text);

/// Without the blanks at both ends (space, tab, carriage return).
constexpr std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r";
  const auto begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

/// `text`, all of it, as a number in decimal digits; nothing if it is not a number or out of range.
/// "nan" and "inf" are doubles.
template <class Number>
std::optional<Number> to_number(std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// `text` from outside (a file, a message) for terminals: control and non-ASCII bytes as \xNN. Of
/// more than `most_bytes`, those, then "... (N bytes)".
std::string printable(std::string_view text, std::size_t most_bytes = 2000);

/// So much of a wrong value is shown in an error.
inline constexpr std::size_t kLongestValueShown = 100;
/// So much of a name.
inline constexpr std::size_t kLongestNameShown = 200;
inline constexpr std::size_t kLongestMessage = 10'000;

/// `text` between double quotes, with a backslash before each quote and backslash in it: a string
/// of TOML, or a label's value in Prometheus' text format, if it is printable().
std::string in_quotes(std::string_view text);

/// A whole message of ours, whatever it quotes: as printable(), but keeps line breaks and
/// characters in UTF-8 that do nothing to a terminal.
std::string printable_message(std::string_view text, std::size_t most_bytes = kLongestMessage);

}  // namespace tether
