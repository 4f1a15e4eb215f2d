#include "common/base/toml_reader.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <sstream>
#include <utility>

#include "common/base/errors.hpp"
#include "common/base/input_file.hpp"
#include "common/base/text.hpp"

namespace tether {
namespace {

std::string range_text(std::int64_t min, std::int64_t max, const std::string& meaning) {
  return fmt::format("a whole number from {} to {} ({})", min, max, meaning);
}

}  // namespace

std::string toml_text(const toml::node& value) {
  if (const auto* number = value.as_floating_point()) {
    const std::string text = fmt::format("{}", number->get());
    return text.find_first_not_of("-0123456789") == std::string::npos ? text + ".0" : text;
  }
  if (const auto* list = value.as_array()) {
    std::vector<std::string> entries;
    for (const toml::node& entry : *list) entries.push_back(toml_text(entry));
    return fmt::format("[{}]", fmt::join(entries, ", "));
  }
  std::ostringstream text;
  text << toml::node_view<const toml::node>(&value);
  return text.str();
}

toml::table parse_toml(const std::string& text, const std::string& file) {
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    throw UsageError(
        fmt::format("{}:{}: {}", file, error.source().begin.line, error.description()));
  }
}

toml::table read_toml(const std::string& file, const std::string& what) {
  return parse_toml(read_input(file, what, kMostTomlBytes), file);
}

TomlReader::TomlReader(const toml::table& table, std::string file, std::string path,
                       const std::vector<std::string>& keys)
    : table_(table), file_(std::move(file)), path_(std::move(path)) {
  for (const auto& [key, node] : table_) {
    const std::string name(key.str());
    if (std::find(keys.begin(), keys.end(), name) != keys.end()) continue;
    refuse_at(key.source().begin.line,
              fmt::format("unknown key \"{}\": allowed are {}",
                          printable(full(name), kLongestValueShown), fmt::join(keys, ", ")));
  }
}

std::string TomlReader::full(const std::string& key) const {
  return path_.empty() ? key : path_ + "." + key;
}

void TomlReader::refuse_at(std::uint32_t line, const std::string& message) const {
  throw UsageError(fmt::format("{}:{}: {}", file_, line, message));
}

void TomlReader::refuse(const std::string& key, const toml::node& value,
                        const std::string& allowed) const {
  refuse_at(value.source().begin.line,
            fmt::format("{} = {} is not allowed: must be {}", full(key),
                        printable(toml_text(value), kLongestValueShown), allowed));
}

const toml::node& TomlReader::require(const std::string& key, const std::string& allowed) const {
  const toml::node* const node = find(key);
  // The top of a file has no line of its own.
  if (node == nullptr) {
    refuse_at(std::max(line(), std::uint32_t{1}),
              fmt::format("{} is missing: must be {}", full(key), allowed));
  }
  return *node;
}

std::optional<std::int64_t> TomlReader::whole_number(const std::string& key, std::int64_t min,
                                                     std::int64_t max,
                                                     const std::string& meaning) const {
  const toml::node* const node = find(key);
  if (node == nullptr) return std::nullopt;
  const auto* const value = node->as_integer();
  if (value == nullptr || value->get() < min || value->get() > max) {
    refuse(key, *node, range_text(min, max, meaning));
  }
  return value->get();
}

void TomlReader::number(const std::string& key, double& out, double min, double max,
                        const std::string& meaning) const {
  const toml::node* const node = find(key);
  if (node == nullptr) return;
  const auto value = node->is_number() ? node->value<double>() : std::nullopt;
  // Written so that NaN is refused, too.
  if (!value || !(*value >= min && *value <= max)) {
    refuse(key, *node, fmt::format("a number from {} to {} ({})", min, max, meaning));
  }
  out = *value;
}

void TomlReader::flag(const std::string& key, bool& out, const std::string& meaning) const {
  const toml::node* const node = find(key);
  if (node == nullptr) return;
  const auto* const value = node->as_boolean();
  if (value == nullptr) refuse(key, *node, fmt::format("true or false ({})", meaning));
  out = value->get();
}

void TomlReader::text(const std::string& key, std::string& out, const std::string& meaning) const {
  const toml::node* const node = find(key);
  if (node == nullptr) return;
  const auto* const value = node->as_string();
  if (value == nullptr || value->get().empty()) {
    refuse(key, *node, fmt::format("a text in quotes ({})", meaning));
  }
  out = value->get();
}

std::vector<std::int64_t> TomlReader::integers(const std::string& key, std::int64_t min,
                                               std::int64_t max, const std::string& meaning) const {
  const toml::node* const node = find(key);
  if (node == nullptr) return {};
  const auto fits = [&](const toml::node& n) {
    const auto* const value = n.as_integer();
    return value != nullptr && value->get() >= min && value->get() <= max;
  };
  const std::string allowed = range_text(min, max, meaning) + ", or several in [ ]";
  const auto* const array = node->as_array();
  if (array == nullptr) {
    if (!fits(*node)) refuse(key, *node, allowed);
    return {node->as_integer()->get()};
  }
  std::vector<std::int64_t> values;
  for (const toml::node& element : *array) {
    if (!fits(element)) refuse(key, *node, allowed);
    values.push_back(element.as_integer()->get());
  }
  if (values.empty()) refuse(key, *node, allowed);
  return values;
}

}  // namespace tether
