#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tether {

/// An ECMAScript regular expression that whole texts match or do not.
class Pattern {
 public:
  /// Throws UsageError, which quotes the expression and says what is wrong with it.
  explicit Pattern(const std::string& expression);

  bool matches(std::string_view text) const;

  /// What the groups, from the first on, hold; empty: that group took no part. nullopt: no match.
  std::optional<std::vector<std::string>> groups(std::string_view text) const;

  /// `replacement` with its $1, $&, $$ … put in. nullopt: no match.
  std::optional<std::string> replaced(std::string_view text, const std::string& replacement) const;

  /// How many groups the expression has.
  std::size_t group_count() const;

 private:
  struct Compiled;
  std::shared_ptr<const Compiled> compiled_;
};

}  // namespace tether
