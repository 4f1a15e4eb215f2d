#pragma once

#include <toml++/toml.h>

#include <cstdint>
#include <set>
#include <string>

namespace tether {

/// A table of the experiment file, which must have these keys and no others. All throw UsageError
/// that names file, line, key and what is allowed.
class Section {
 public:
  Section(const toml::table& table, std::string name, std::string file,
          const std::set<std::string>& known);

  const toml::node* get(const std::string& key) const { return table_.get(key); }
  std::string text(const std::string& key, const std::string& otherwise) const;
  double number(const std::string& key, double low, double high, double otherwise) const;
  std::int64_t whole(const std::string& key, std::int64_t low, std::int64_t otherwise) const;
  bool boolean(const std::string& key, bool otherwise) const;
  /// The name of one of metrics(); epsilon_m if there is none.
  std::string metric(const std::string& key) const;
  /// The metric of a key, or an expression over metrics (metric_expression.hpp).
  std::string metric_expression(const std::string& key) const;
  /// A table within it; null if there is none.
  const toml::table* table(const std::string& key) const;

  [[noreturn]] void refuse(const std::string& key, const std::string& allowed) const;

  static constexpr std::int64_t kMostWhole = 1'000'000;

 private:
  const toml::table& table_;
  std::string name_;  // "precision."
  std::string file_;
};

}  // namespace tether
