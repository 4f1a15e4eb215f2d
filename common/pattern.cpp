#include "common/pattern.hpp"

#include <fmt/format.h>

#include <regex>

#include "common/errors.hpp"

namespace tether {
namespace {

using Match = std::match_results<std::string_view::const_iterator>;

}  // namespace

struct Pattern::Compiled {
  std::regex regex;

  std::optional<Match> match(std::string_view text) const {
    Match match;
    if (!std::regex_match(text.begin(), text.end(), match, regex)) return std::nullopt;
    return match;
  }
};

Pattern::Pattern(const std::string& expression) try
    : compiled_(std::make_shared<Compiled>(Compiled{std::regex(expression)})) {
} catch (const std::regex_error& error) {
  throw UsageError(fmt::format("\"{}\" is not a regular expression: {}", expression, error.what()));
}

bool Pattern::matches(std::string_view text) const { return compiled_->match(text).has_value(); }

std::optional<std::vector<std::string>> Pattern::groups(std::string_view text) const {
  const std::optional<Match> match = compiled_->match(text);
  if (!match) return std::nullopt;
  return std::vector<std::string>(std::next(match->begin()), match->end());
}

std::optional<std::string> Pattern::replaced(std::string_view text,
                                             const std::string& replacement) const {
  const std::optional<Match> match = compiled_->match(text);
  if (!match) return std::nullopt;
  return match->format(replacement);
}

std::size_t Pattern::group_count() const { return compiled_->regex.mark_count(); }

}  // namespace tether
