#pragma once

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <regex>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/scenario_keys.hpp"

namespace tether {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Allowed finite numbers: [low, high], without low itself if `open`.
struct Range {
  double low = -kInfinity;
  double high = kInfinity;
  bool open = false;

  bool contains(double x) const {
    return std::isfinite(x) && (open ? x > low : x >= low) && x <= high;
  }
  std::string text(const char* noun) const {
    if (std::isinf(low)) return fmt::format("a finite {}", noun);
    if (std::isinf(high)) return fmt::format("a finite {} {} {}", noun, open ? ">" : ">=", low);
    return fmt::format("a {} in {}{}, {}]", noun, open ? "(" : "[", low, high);
  }
};

// Ranges that many keys have.
inline constexpr Range kRatio{0.0, 1.0, false};
inline constexpr Range kSojourn{1e-3, 1e9, false};

template <class Enum>
using Names = std::vector<std::pair<std::string, Enum>>;

inline std::optional<double> as_double(const ScenarioValue& value) {
  if (const auto* d = std::get_if<double>(&value)) return *d;
  if (const auto* i = std::get_if<std::int64_t>(&value)) return static_cast<double>(*i);
  return std::nullopt;
}

/// Collects keys; `field` is a function from (const) Scenario& to the (const) member's reference.
class KeyTable {
 public:
  template <class Field>
  void number(const std::string& name, Field field, Range range, const std::string& meaning) {
    add(
        name, range.text("number"), meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        number_setter(field, range));
  }

  template <class Field>
  void optional_number(const std::string& name, Field field, Range range,
                       const std::string& meaning) {
    add(
        name, range.text("number"), meaning,
        [field](const Scenario& s) {
          const std::optional<double>& x = field(s);
          return x ? std::optional<ScenarioValue>(*x) : std::nullopt;
        },
        number_setter(field, range));
  }

  template <class Field>
  void whole_number(const std::string& name, Field field, std::int64_t low,
                    const std::string& meaning) {
    const Range range{static_cast<double>(low), kInfinity, false};
    add(
        name, range.text("whole number"), meaning,
        [field](const Scenario& s) {
          return std::optional<ScenarioValue>(static_cast<std::int64_t>(field(s)));
        },
        [field, low](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<std::int64_t>(&value);
          if (x == nullptr || *x < low) return false;
          field(s) = static_cast<std::remove_reference_t<decltype(field(s))>>(*x);
          return true;
        });
  }

  template <class Field>
  void boolean(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "true or false", meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        [field](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<bool>(&value);
          if (x == nullptr) return false;
          field(s) = *x;
          return true;
        });
  }

  template <class Enum, class Field>
  void choice(const std::string& name, Field field, const Names<Enum>& names,
              const std::string& meaning) {
    std::vector<std::string> quoted;
    for (const auto& [text, unused] : names) quoted.push_back("\"" + text + "\"");
    add(
        name, fmt::format("{}", fmt::join(quoted, " or ")), meaning,
        [field, names](const Scenario& s) {
          for (const auto& [text, value] : names) {
            if (value == field(s)) return std::optional<ScenarioValue>(text);
          }
          return std::optional<ScenarioValue>();
        },
        [field, names](Scenario& s, const ScenarioValue& value) {
          const auto* wanted = std::get_if<std::string>(&value);
          for (const auto& [text, option] : names) {
            if (wanted == nullptr || text != *wanted) continue;
            field(s) = option;
            return true;
          }
          return false;
        });
  }

  template <class Field>
  void identifier(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "letters, digits, '-' and '_', at most 32", meaning,
        [field](const Scenario& s) { return std::optional<ScenarioValue>(field(s)); },
        [field](Scenario& s, const ScenarioValue& value) {
          static const std::regex kPattern("[A-Za-z0-9_-]{1,32}");
          const auto* x = std::get_if<std::string>(&value);
          if (x == nullptr || !std::regex_match(*x, kPattern)) return false;
          field(s) = *x;
          return true;
        });
  }

  /// Names of files and interfaces; empty: not set.
  template <class Field>
  void text(const std::string& name, Field field, const std::string& meaning) {
    add(
        name, "printable text without quotes and backslashes", meaning,
        [field](const Scenario& s) {
          const std::string& x = field(s);
          return x.empty() ? std::nullopt : std::optional<ScenarioValue>(x);
        },
        [field](Scenario& s, const ScenarioValue& value) {
          const auto* x = std::get_if<std::string>(&value);
          const auto bad = [](unsigned char c) {
            return c < 0x20 || c == 0x7F || c == '"' || c == '\\';
          };
          if (x == nullptr || x->empty() || std::any_of(x->begin(), x->end(), bad)) return false;
          field(s) = *x;
          return true;
        });
  }

  /// A list of numbers.
  template <class Field>
  void list(const std::string& name, Field field, Range range, const std::string& meaning) {
    add(
        name, fmt::format("a list, each {}", range.text("number")), meaning,
        [field](const Scenario& s) {
          return field(s).empty() ? std::nullopt : std::optional<ScenarioValue>(field(s));
        },
        [field, range](Scenario& s, const ScenarioValue& value) {
          const auto* list = std::get_if<NumberList>(&value);
          if (list == nullptr || !all_in(range, *list)) return false;
          field(s) = *list;
          return true;
        });
  }

  /// A list of lists of numbers, such as a matrix.
  template <class Field>
  void rows(const std::string& name, Field field, Range range, const std::string& meaning) {
    add(
        name, fmt::format("a list of lists, each {}", range.text("number")), meaning,
        [field](const Scenario& s) {
          return field(s).empty() ? std::nullopt : std::optional<ScenarioValue>(field(s));
        },
        [field, range](Scenario& s, const ScenarioValue& value) {
          const auto* none = std::get_if<NumberList>(&value);
          const auto* rows = std::get_if<NumberRows>(&value);
          const auto in_range = [&range](const NumberList& row) { return all_in(range, row); };
          if (rows == nullptr ? none == nullptr || !none->empty()
                              : !std::all_of(rows->begin(), rows->end(), in_range)) {
            return false;
          }
          field(s) = rows == nullptr ? NumberRows{} : *rows;
          return true;
        });
  }

  std::vector<ScenarioKey> take() { return std::move(keys_); }

 private:
  static bool all_in(Range range, const NumberList& list) {
    return std::all_of(list.begin(), list.end(), [range](double x) { return range.contains(x); });
  }

  template <class Field>
  static decltype(ScenarioKey::set) number_setter(Field field, Range range) {
    return [field, range](Scenario& s, const ScenarioValue& value) {
      const auto x = as_double(value);
      if (!x || !range.contains(*x)) return false;
      field(s) = *x;
      return true;
    };
  }

  void add(const std::string& name, std::string allowed, const std::string& meaning,
           decltype(ScenarioKey::get) get, decltype(ScenarioKey::set) set) {
    keys_.push_back({name, std::move(allowed), meaning, std::move(get), std::move(set)});
  }

  std::vector<ScenarioKey> keys_;
};

// One line a key: the member, reachable through a const and a mutable scenario alike.
#define TETHER_FIELD(member) ([](auto& s) -> auto& { return s.member; })

}  // namespace tether
