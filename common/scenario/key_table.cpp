#include "common/scenario/key_table.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

namespace tether {
std::optional<double> number_of(const ScenarioValue& value) {
  if (const auto* real = std::get_if<double>(&value)) return *real;
  if (const auto* whole = std::get_if<std::int64_t>(&value)) return static_cast<double>(*whole);
  return std::nullopt;
}

namespace {

using Set = decltype(ScenarioKey::set);

bool all_in(Range range, const NumberList& list) {
  return std::all_of(list.begin(), list.end(), [range](double x) { return range.contains(x); });
}

template <class T>
decltype(ScenarioKey::get) getter(const ScenarioField<T>& field) {
  return [field](const Scenario& s) { return ScenarioValue(field.read(s)); };
}

/// Not set if empty.
template <class T>
decltype(ScenarioKey::get) get_unless_empty(const ScenarioField<T>& field) {
  return [field](const Scenario& s) {
    const T& x = field.read(s);
    return x.empty() ? std::nullopt : std::optional<ScenarioValue>(x);
  };
}

bool is_text(const std::string& text) {
  const auto bad = [](unsigned char c) { return c < 0x20 || c == 0x7F || c == '"' || c == '\\'; };
  return !text.empty() && std::none_of(text.begin(), text.end(), bad);
}

/// Allowed range of a numeric key. Of a time or a rate from 0 on, 0 means something else than a
/// tiny one, which would round to 0, or whose inverse would be endless.
struct Allowed {
  Range range;
  bool or_zero = false;

  bool contains(double x) const { return (or_zero && x == 0.0) || range.contains(x); }
  std::string text() const { return (or_zero ? "0 or " : "") + range.text("number"); }
};

Allowed allowed_of(const std::string& name, const Range& range) {
  const bool is_rate = name.ends_with("_hz");
  const bool is_time = name.ends_with("_ms") || (name.ends_with("_s") && !name.ends_with("_per_s"));
  if (range.low != 0.0 || !(is_rate || is_time)) return {range};
  const double least = is_rate ? kRate.low : name.ends_with("_ms") ? 1e-6 : 1e-9;  // 1 ns
  return {{least, range.high, false}, !range.open};
}

template <class T>
Set number_setter(const ScenarioField<T>& field, const Allowed& allowed) {
  return [field, allowed](Scenario& s, const ScenarioValue& value) {
    const auto x = number_of(value);
    if (!x || !allowed.contains(*x)) return false;
    field.write(s) = *x;
    return true;
  };
}

Set text_setter(const ScenarioField<std::string>& field, bool (*allowed)(const std::string&)) {
  return [field, allowed](Scenario& s, const ScenarioValue& value) {
    const auto* x = std::get_if<std::string>(&value);
    if (x == nullptr || !allowed(*x)) return false;
    field.write(s) = *x;
    return true;
  };
}

}  // namespace

bool is_identifier(const std::string& text) {
  const auto good = [](unsigned char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' ||
           c == '-';
  };
  return !text.empty() && text.size() <= 32 && std::all_of(text.begin(), text.end(), good);
}

bool Range::contains(double x) const {
  return std::isfinite(x) && (open ? x > low : x >= low) && x <= high;
}

std::string Range::text(const char* noun) const {
  if (std::isinf(low)) return fmt::format("a finite {}", noun);
  if (std::isinf(high)) return fmt::format("a finite {} {} {}", noun, open ? ">" : ">=", low);
  return fmt::format("a {} in {}{}, {}]", noun, open ? "(" : "[", low, high);
}

ScenarioKey number_key(const std::string& name, const ScenarioField<double>& field, Range range,
                       const std::string& meaning) {
  const Allowed allowed = allowed_of(name, range);
  return {name, allowed.text(), meaning, getter(field), number_setter(field, allowed)};
}

ScenarioKey optional_number_key(const std::string& name,
                                const ScenarioField<std::optional<double>>& field, Range range,
                                const std::string& meaning) {
  const auto get = [field](const Scenario& s) {
    const std::optional<double>& x = field.read(s);
    return x ? std::optional<ScenarioValue>(*x) : std::nullopt;
  };
  const Allowed allowed = allowed_of(name, range);
  return {name, allowed.text(), meaning, get, number_setter(field, allowed)};
}

ScenarioKey boolean_key(const std::string& name, const ScenarioField<bool>& field,
                        const std::string& meaning) {
  const auto set = [field](Scenario& s, const ScenarioValue& value) {
    const auto* x = std::get_if<bool>(&value);
    if (x == nullptr) return false;
    field.write(s) = *x;
    return true;
  };
  return {name, "true or false", meaning, getter(field), set};
}

ScenarioKey whole_number_key(const std::string& name,
                             std::function<std::int64_t(const Scenario&)> get,
                             std::function<void(Scenario&, std::int64_t)> set, std::int64_t low,
                             const std::string& meaning) {
  const Range range{static_cast<double>(low), kInfinity, false};
  return {name, range.text("whole number"), meaning,
          [get = std::move(get)](const Scenario& s) { return ScenarioValue(get(s)); },
          [set = std::move(set), low](Scenario& s, const ScenarioValue& value) {
            const auto* x = std::get_if<std::int64_t>(&value);
            if (x == nullptr || *x < low) return false;
            set(s, *x);
            return true;
          }};
}

ScenarioKey identifier_key(const std::string& name, const ScenarioField<std::string>& field,
                           const std::string& meaning) {
  return {name, "letters, digits, '-' and '_', at most 32", meaning, getter(field),
          text_setter(field, is_identifier)};
}

ScenarioKey text_key(const std::string& name, const ScenarioField<std::string>& field,
                     const std::string& meaning) {
  return {name, "printable text without quotes and backslashes", meaning, get_unless_empty(field),
          text_setter(field, is_text)};
}

ScenarioKey list_key(const std::string& name, const ScenarioField<NumberList>& field, Range range,
                     const std::string& meaning) {
  const auto set = [field, range](Scenario& s, const ScenarioValue& value) {
    const auto* list = std::get_if<NumberList>(&value);
    if (list == nullptr || !all_in(range, *list)) return false;
    field.write(s) = *list;
    return true;
  };
  return {name, fmt::format("a list, each {}", range.text("number")), meaning,
          get_unless_empty(field), set};
}

ScenarioKey rows_key(const std::string& name, const ScenarioField<NumberRows>& field, Range range,
                     const std::string& meaning) {
  const auto set = [field, range](Scenario& s, const ScenarioValue& value) {
    const auto* none = std::get_if<NumberList>(&value);
    const auto* rows = std::get_if<NumberRows>(&value);
    const auto in_range = [&range](const NumberList& row) { return all_in(range, row); };
    if (rows == nullptr ? none == nullptr || !none->empty()
                        : !std::all_of(rows->begin(), rows->end(), in_range)) {
      return false;
    }
    field.write(s) = rows == nullptr ? NumberRows{} : *rows;
    return true;
  };
  return {name, fmt::format("a list of lists, each {}", range.text("number")), meaning,
          get_unless_empty(field), set};
}

ScenarioKey choice_key(const std::string& name, const std::vector<std::string>& texts,
                       std::function<std::size_t(const Scenario&)> get,
                       std::function<void(Scenario&, std::size_t)> set,
                       const std::string& meaning) {
  std::vector<std::string> quoted;
  for (const std::string& text : texts) quoted.push_back("\"" + text + "\"");
  return {name, fmt::format("{}", fmt::join(quoted, " or ")), meaning,
          [get = std::move(get), texts](const Scenario& s) {
            const std::size_t i = get(s);
            return i < texts.size() ? std::optional<ScenarioValue>(texts[i]) : std::nullopt;
          },
          [set = std::move(set), texts](Scenario& s, const ScenarioValue& value) {
            const auto* wanted = std::get_if<std::string>(&value);
            if (wanted == nullptr) return false;
            const auto found = std::find(texts.begin(), texts.end(), *wanted);
            if (found == texts.end()) return false;
            set(s, static_cast<std::size_t>(found - texts.begin()));
            return true;
          }};
}

}  // namespace tether
