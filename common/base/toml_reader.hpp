#pragma once

#include <toml++/toml.h>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tether {

/// A value for messages, as TOML has it, each number by the shortest text that reads as the same
/// (toml++ prints 0.1 with 17 digits).
std::string toml_text(const toml::node& value);

/// `text`, which `file` has, as TOML. Throws UsageError: file, line, what is wrong.
toml::table parse_toml(const std::string& text, const std::string& file);
/// All of a file, of kMostTomlBytes at most; `what` is its kind, such as "the experiment file".
toml::table read_toml(const std::string& file, const std::string& what);

/// One table of a TOML file, read strictly: a key that is not in `keys` is refused at once, and a
/// value of another type or out of range when it is asked for. Each refusal is a UsageError of one
/// line: file, line, key, value, what is allowed.
///
/// A key that is absent leaves the given variable as it was.
class TomlReader {
 public:
  /// `path` precedes keys in messages ("left"); "" for the top of the file. `table` must outlive
  /// the reader.
  TomlReader(const toml::table& table, std::string file, std::string path,
             const std::vector<std::string>& keys);

  bool has(const std::string& key) const { return table_.contains(key); }

  template <class Integer>
  void integer(const std::string& key, Integer& out, std::int64_t min, std::int64_t max,
               const std::string& meaning) const {
    if (const auto value = whole_number(key, min, max, meaning)) out = static_cast<Integer>(*value);
  }
  void number(const std::string& key, double& out, double min, double max,
              const std::string& meaning) const;
  void flag(const std::string& key, bool& out, const std::string& meaning) const;
  void text(const std::string& key, std::string& out, const std::string& meaning) const;
  /// One whole number, or an array of at least one; empty if absent.
  std::vector<std::int64_t> integers(const std::string& key, std::int64_t min, std::int64_t max,
                                     const std::string& meaning) const;

  /// nullptr if absent.
  const toml::node* find(const std::string& key) const { return table_.get(key); }
  /// Refuses the table if it has no such key.
  const toml::node& require(const std::string& key, const std::string& allowed) const;

  /// Line of the table's beginning.
  std::uint32_t line() const { return table_.source().begin.line; }
  const std::string& file() const { return file_; }

  [[noreturn]] void refuse(const std::string& key, const toml::node& value,
                           const std::string& allowed) const;
  [[noreturn]] void refuse_at(std::uint32_t line, const std::string& message) const;

 private:
  std::optional<std::int64_t> whole_number(const std::string& key, std::int64_t min,
                                           std::int64_t max, const std::string& meaning) const;
  std::string full(const std::string& key) const;

  const toml::table& table_;
  std::string file_;
  std::string path_;
};

}  // namespace tether
