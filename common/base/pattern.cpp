#include "common/base/pattern.hpp"

#include <fmt/format.h>
#include <re2/re2.h>

#include <algorithm>
#include <cctype>
#include <utility>

#include "common/base/errors.hpp"

namespace tether {
namespace {

/// Bytes as they are: channel names are of no particular encoding.
RE2::Options options() {
  RE2::Options options(RE2::Latin1);
  options.set_log_errors(false);
  return options;
}

bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }

std::string reason(const RE2& regex) {
  const std::string& part = regex.error_arg();
  const bool is_reference = regex.error_code() == RE2::ErrorBadEscape && part.size() > 1 &&
                            (is_digit(part[1]) || part[1] == 'k');
  if (is_reference || regex.error_code() == RE2::ErrorBadPerlOp) {
    return fmt::format(
        "\"{}\": there is no looking around (?= ?! ?<) and no repeating of a group "
        "(\\1), so that no text takes long to match",
        part);
  }
  return regex.error();
}

}  // namespace

struct Pattern::Compiled {
  /// The text of each group; group 0 is the whole text. A piece without data is a group that took
  /// no part in the match.
  using Groups = std::vector<re2::StringPiece>;

  explicit Compiled(const std::string& expression) : regex(expression, options()) {}

  std::optional<Groups> match(std::string_view text) const {
    Groups found(static_cast<std::size_t>(regex.NumberOfCapturingGroups()) + 1);
    const re2::StringPiece all(text.data(), text.size());
    if (!regex.Match(all, 0, text.size(), RE2::ANCHOR_BOTH, found.data(),
                     static_cast<int>(found.size()))) {
      return std::nullopt;
    }
    return found;
  }

  RE2 regex;
};

Pattern::Pattern(const std::string& expression)
    : compiled_(std::make_shared<Compiled>(expression)) {
  if (compiled_->regex.ok()) return;
  throw UsageError(
      fmt::format("\"{}\" is not a regular expression: {}", expression, reason(compiled_->regex)));
}

bool Pattern::matches(std::string_view text) const {
  return RE2::FullMatch({text.data(), text.size()}, compiled_->regex);
}

std::optional<std::vector<std::string>> Pattern::groups(std::string_view text) const {
  const auto found = compiled_->match(text);
  if (!found) return std::nullopt;
  std::vector<std::string> texts;
  for (std::size_t i = 1; i < found->size(); ++i) texts.push_back((*found)[i].as_string());
  return texts;
}

std::optional<std::string> Pattern::replaced(std::string_view text,
                                             const std::string& replacement) const {
  const auto found = compiled_->match(text);
  if (!found) return std::nullopt;
  std::string made;
  for (std::size_t i = 0; i < replacement.size(); ++i) {
    const char next =
        replacement[i] == '$' && i + 1 < replacement.size() ? replacement[i + 1] : '\0';
    if (next == '$') {
      made += '$';
      ++i;
    } else if (next == '&') {
      made += text;
      ++i;
    } else if (is_digit(next)) {
      std::size_t number = 0;
      for (int digits = 0; digits < 2 && i + 1 < replacement.size(); ++digits) {
        if (!is_digit(replacement[i + 1])) break;
        number = 10 * number + static_cast<std::size_t>(replacement[++i] - '0');
      }
      if (number < found->size()) made += (*found)[number].as_string();
    } else {
      made += replacement[i];
    }
  }
  return made;
}

std::size_t Pattern::group_count() const {
  return static_cast<std::size_t>(compiled_->regex.NumberOfCapturingGroups());
}

void Pattern::check_replacement(const std::string& replacement) const {
  const std::size_t groups = group_count();
  for (auto at = replacement.find('$'); at != std::string::npos;
       at = replacement.find('$', at + 2)) {
    const std::string next = replacement.substr(at + 1, 1);
    if (next == "$" || next == "&") continue;
    std::string digits = replacement.substr(at + 1, 2);
    digits.resize(std::min(digits.find_first_not_of("0123456789"), digits.size()));
    const std::size_t number = digits.empty() ? 0 : std::stoul(digits);
    if (number >= 1 && number <= groups) continue;
    throw UsageError(
        fmt::format("\"{}\": ${} means nothing: allowed are $1 … for the {} group{} of the "
                    "pattern, $& for the whole name, $$ for a dollar",
                    replacement, digits.empty() ? next : digits, groups, groups == 1 ? "" : "s"));
  }
}

}  // namespace tether
