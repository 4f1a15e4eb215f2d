#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// A regular expression of RE2 that whole texts match or do not: what Perl and ECMAScript have, but
/// for looking around and back-references. In return the time is linear in the text, whatever the
/// expression: names that come from the network stop nobody. Bytes are compared, not characters;
/// "." is any but a line feed.
class Pattern {
 public:
  /// Throws UsageError, which quotes the expression and says what is wrong with it.
  explicit Pattern(const std::string& expression);

  bool matches(std::string_view text) const;

  /// What the groups, from the first on, hold; empty: that group took no part. nullopt: no match.
  std::optional<std::vector<std::string>> groups(std::string_view text) const;

  /// `replacement` with its $1 … $99 (groups; those that took no part are empty), $& (all) and $$
  /// (a dollar) put in. nullopt: no match.
  std::optional<std::string> replaced(std::string_view text, const std::string& replacement) const;

  /// How many groups the expression has.
  std::size_t group_count() const;

 private:
  struct Compiled;
  std::shared_ptr<const Compiled> compiled_;
};

}  // namespace tether
