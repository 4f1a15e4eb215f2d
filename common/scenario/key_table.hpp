#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "common/scenario/keys.hpp"

namespace tether {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Allowed finite numbers: [low, high], without low itself if `open`.
struct Range {
  double low = -kInfinity;
  double high = kInfinity;
  bool open = false;

  bool contains(double x) const;
  std::string text(const char* noun) const;
};

// Ranges that many keys have.
inline constexpr Range kRatio{0.0, 1.0, false};
inline constexpr Range kSojourn{1e-3, 1e9, false};

template <class Enum>
using Names = std::vector<std::pair<std::string, Enum>>;

/// Letters, digits, '-' and '_', at most 32, and at least one.
bool is_identifier(const std::string& text);

/// Collects keys.
class KeyTable {
 public:
  /// Where in a scenario a key's value is: any function from (const) Scenario& to the (const)
  /// member's reference.
  template <class T>
  struct Field {
    template <class F>
    Field(F f) : read(f), write(f) {}  // NOLINT(google-explicit-constructor)
    std::function<const T&(const Scenario&)> read;
    std::function<T&(Scenario&)> write;
  };

  void number(const std::string& name, const Field<double>& field, Range range,
              const std::string& meaning);
  void optional_number(const std::string& name, const Field<std::optional<double>>& field,
                       Range range, const std::string& meaning);
  void boolean(const std::string& name, const Field<bool>& field, const std::string& meaning);
  void identifier(const std::string& name, const Field<std::string>& field,
                  const std::string& meaning);
  /// Names of files and interfaces; empty: not set.
  void text(const std::string& name, const Field<std::string>& field, const std::string& meaning);
  /// A list of numbers.
  void list(const std::string& name, const Field<NumberList>& field, Range range,
            const std::string& meaning);
  /// A list of lists of numbers, such as a matrix.
  void rows(const std::string& name, const Field<NumberRows>& field, Range range,
            const std::string& meaning);

  /// Of any integer type.
  template <class F>
  void whole_number(const std::string& name, F field, std::int64_t low,
                    const std::string& meaning) {
    using Whole = std::remove_reference_t<std::invoke_result_t<F, Scenario&>>;
    add_whole(
        name, [field](const Scenario& s) { return static_cast<std::int64_t>(field(s)); },
        [field](Scenario& s, std::int64_t x) { field(s) = static_cast<Whole>(x); }, low, meaning);
  }

  template <class Enum, class F>
  void choice(const std::string& name, F field, const Names<Enum>& names,
              const std::string& meaning) {
    std::vector<std::string> texts;
    std::vector<Enum> values;
    for (const auto& [text, value] : names) {
      texts.push_back(text);
      values.push_back(value);
    }
    add_choice(
        name, texts,
        [field, values](const Scenario& s) {
          std::size_t i = 0;
          while (i < values.size() && values[i] != field(s)) ++i;
          return i;
        },
        [field, values](Scenario& s, std::size_t i) { field(s) = values[i]; }, meaning);
  }

  std::vector<ScenarioKey> take() { return std::move(keys_); }

 private:
  template <class T>
  using Getter = std::function<T(const Scenario&)>;
  template <class T>
  using Setter = std::function<void(Scenario&, T)>;
  void add_whole(const std::string& name, const Getter<std::int64_t>& get,
                 const Setter<std::int64_t>& set, std::int64_t low, const std::string& meaning);
  void add_choice(const std::string& name, const std::vector<std::string>& texts,
                  const Getter<std::size_t>& get, const Setter<std::size_t>& set,
                  const std::string& meaning);

  std::vector<ScenarioKey> keys_;
};

// One line a key: the member.
#define TETHER_FIELD(member) ([](auto& s) -> auto& { return s.member; })

}  // namespace tether
