#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// A regular expression of RE2, matched against whole texts. It has what Perl and ECMAScript have,
/// except look-around and back-references. In return, matching takes time linear in the text,
/// whatever the expression, so that names from the network cannot stall a program. Bytes are
/// compared, not characters; "." is any but a line feed.
class Pattern {
 public:
  /// Throws UsageError, which quotes the expression and says what is wrong with it.
  explicit Pattern(const std::string& expression);

  bool matches(std::string_view text) const;

  /// Contents of the groups, from the first on; empty: that group took no part. nullopt: no match.
  std::optional<std::vector<std::string>> groups(std::string_view text) const;

  /// `replacement` with its $1 … $99 (groups; those that took no part are empty), $& (all) and $$
  /// (a dollar) put in. nullopt: no match.
  std::optional<std::string> replaced(std::string_view text, const std::string& replacement) const;

  /// How many groups the expression has.
  std::size_t group_count() const;

  /// Throws UsageError for a replacement of which a $… means nothing to this pattern: a group that
  /// it does not have, or none of $1 … $99, $&, $$.
  void check_replacement(const std::string& replacement) const;

 private:
  struct Compiled;
  std::shared_ptr<const Compiled> compiled_;
};

}  // namespace tether
