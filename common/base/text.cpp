#include "common/base/text.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/errors.hpp"

namespace tether {
namespace {

/// Length of the well-formed UTF-8 character that `text` begins with; 0 if there is none, or if it
/// is a control (U+0080 to U+009F, which terminals obey) or a mark that turns the writing around.
std::size_t character_bytes(std::string_view text) {
  const auto byte = [text](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const std::size_t length = byte(0) >= 0xF0 ? 4 : byte(0) >= 0xE0 ? 3 : 2;
  if (byte(0) < 0xC2 || byte(0) > 0xF4 || text.size() < length) return 0;
  char32_t code = byte(0) & (0xFFU >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80) return 0;
    code = code << 6 | (byte(i) & 0x3FU);
  }
  const bool too_long = (length == 3 && code < 0x800) || (length == 4 && code < 0x10000);
  const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
  const bool control = code < 0xA0 || (code >= 0x200E && code <= 0x200F) ||
                       (code >= 0x2028 && code <= 0x202E) || (code >= 0x2066 && code <= 0x2069);
  return too_long || surrogate || control || code > 0x10FFFF ? 0 : length;
}

std::string shown(std::string_view text, std::size_t most_bytes, bool keep_characters) {
  std::string safe;
  std::size_t i = 0;
  while (i < std::min(text.size(), most_bytes)) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const bool plain = (byte >= 0x20 && byte < 0x7F) || (keep_characters && byte == '\n');
    std::size_t length = plain ? 1 : 0;
    if (byte >= 0x80 && keep_characters) length = character_bytes(text.substr(i));
    if (length > 0) {
      safe += text.substr(i, length);
    } else {
      safe += fmt::format("\\x{:02x}", byte);
    }
    i += std::max<std::size_t>(length, 1);
  }
  if (i < text.size()) safe += fmt::format("... ({} bytes)", text.size());
  return safe;
}

}  // namespace

std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

std::string printable(std::string_view text, std::size_t most_bytes) {
  return shown(text, most_bytes, false);
}

std::string printable_message(std::string_view text, std::size_t most_bytes) {
  return shown(text, most_bytes, true);
}

std::optional<std::pair<std::string, std::string>> split_at_arrow(const std::string& text) {
  std::size_t found = std::string::npos, length = 0;
  for (const std::string arrow : {"→", "->"}) {
    for (auto at = text.find(arrow); at != std::string::npos; at = text.find(arrow, at + 1)) {
      if (found != std::string::npos) {
        throw UsageError("two arrows; write -[>] for an arrow in a pattern");
      }
      found = at;
      length = arrow.size();
    }
  }
  if (found == std::string::npos) return std::nullopt;
  return std::pair{std::string(trimmed(text.substr(0, found))),
                   std::string(trimmed(text.substr(found + length)))};
}

}  // namespace tether
