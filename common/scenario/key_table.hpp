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

#include "common/scenario/section.hpp"

namespace tether {

/// A number, whole or not; nullopt: it is something else.
std::optional<double> number_of(const ScenarioValue& value);

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Allowed finite numbers: [low, high], without low itself if `open`.
struct Range {
  double low = -kInfinity;
  double high = kInfinity;
  bool open = false;

  bool contains(double x) const;
  std::string text(const char* noun) const;
};

// Ranges that many keys have: physical ones, wide but such that nothing overflows within them.
inline constexpr Range kRatio{0.0, 1.0, false};
inline constexpr Range kNotNegative{0.0, 1e6, false};
inline constexpr Range kPositive{1e-3, 1e6, false};
inline constexpr Range kRate{1e-3, 1000.0, false};  // Hz: the physics step is 1 ms
inline constexpr Range kLength{1e-3, 100.0, false};

template <class Enum>
using Names = std::vector<std::pair<std::string, Enum>>;

/// Letters, digits, '-' and '_', at most 32, and at least one.
bool is_identifier(const std::string& text);

/// Where in a scenario a key's value is.
template <class T>
struct ScenarioField {
  std::function<const T&(const Scenario&)> read;
  std::function<T&(Scenario&)> write;
};

// Keys of each kind of value. `name` is the full one.
ScenarioKey number_key(const std::string& name, const ScenarioField<double>& field, Range range,
                       const std::string& meaning);
ScenarioKey optional_number_key(const std::string& name,
                                const ScenarioField<std::optional<double>>& field, Range range,
                                const std::string& meaning);
ScenarioKey boolean_key(const std::string& name, const ScenarioField<bool>& field,
                        const std::string& meaning);
ScenarioKey whole_number_key(const std::string& name,
                             std::function<std::int64_t(const Scenario&)> get,
                             std::function<void(Scenario&, std::int64_t)> set, std::int64_t low,
                             const std::string& meaning);
ScenarioKey identifier_key(const std::string& name, const ScenarioField<std::string>& field,
                           const std::string& meaning);
/// Names of files and interfaces; empty: not set.
ScenarioKey text_key(const std::string& name, const ScenarioField<std::string>& field,
                     const std::string& meaning);
/// A list of numbers.
ScenarioKey list_key(const std::string& name, const ScenarioField<NumberList>& field, Range range,
                     const std::string& meaning);
/// A list of lists of numbers, such as a matrix.
ScenarioKey rows_key(const std::string& name, const ScenarioField<NumberRows>& field, Range range,
                     const std::string& meaning);
/// One of several texts; the value is the text's place among them.
ScenarioKey choice_key(const std::string& name, const std::vector<std::string>& texts,
                       std::function<std::size_t(const Scenario&)> get,
                       std::function<void(Scenario&, std::size_t)> set, const std::string& meaning);

/// Collects the keys of one struct of settings, a line each. `member` is a pointer to a member, or
/// for members of members TETHER_MEMBER(v.p).
template <class Settings>
class KeyTable {
 public:
  /// For a section whose settings are this struct. All names get `prefix`.
  explicit KeyTable(std::string prefix)
      : KeyTable(std::move(prefix),
                 {[](const Scenario& s) -> const Settings& { return s.get<Settings>(); },
                  [](Scenario& s) -> Settings& { return s.get<Settings>(); }}) {}
  /// For a struct anywhere in a scenario.
  KeyTable(std::string prefix, ScenarioField<Settings> settings)
      : prefix_(std::move(prefix)), settings_(std::move(settings)) {}

  /// For a struct within this one.
  template <class Inner, class Member>
  KeyTable<Inner> within(const std::string& prefix, Member member) const {
    return {prefix_ + prefix, field<Inner>(member)};
  }

  template <class Member>
  void number(const std::string& name, Member member, Range range, const std::string& meaning) {
    keys_.push_back(number_key(prefix_ + name, field<double>(member), range, meaning));
  }
  template <class Member>
  void optional_number(const std::string& name, Member member, Range range,
                       const std::string& meaning) {
    keys_.push_back(
        optional_number_key(prefix_ + name, field<std::optional<double>>(member), range, meaning));
  }
  template <class Member>
  void boolean(const std::string& name, Member member, const std::string& meaning) {
    keys_.push_back(boolean_key(prefix_ + name, field<bool>(member), meaning));
  }
  template <class Member>
  void identifier(const std::string& name, Member member, const std::string& meaning) {
    keys_.push_back(identifier_key(prefix_ + name, field<std::string>(member), meaning));
  }
  template <class Member>
  void text(const std::string& name, Member member, const std::string& meaning) {
    keys_.push_back(text_key(prefix_ + name, field<std::string>(member), meaning));
  }
  /// The name of a file, relative to where it is given.
  template <class Member>
  void file(const std::string& name, Member member, const std::string& meaning) {
    text(name, member, meaning);
    keys_.back().file = field<std::string>(member).write;
  }
  template <class Member>
  void list(const std::string& name, Member member, Range range, const std::string& meaning) {
    keys_.push_back(list_key(prefix_ + name, field<NumberList>(member), range, meaning));
  }
  template <class Member>
  void rows(const std::string& name, Member member, Range range, const std::string& meaning) {
    keys_.push_back(rows_key(prefix_ + name, field<NumberRows>(member), range, meaning));
  }
  /// Reference to a member of any integer type.
  template <class Member>
  void whole_number(const std::string& name, Member member, std::int64_t low,
                    const std::string& meaning) {
    using Whole = std::remove_cvref_t<std::invoke_result_t<Member, Settings&>>;
    const auto of = field<Whole>(member);
    keys_.push_back(whole_number_key(
        prefix_ + name, [of](const Scenario& s) { return static_cast<std::int64_t>(of.read(s)); },
        [of](Scenario& s, std::int64_t x) { of.write(s) = static_cast<Whole>(x); }, low, meaning));
  }
  template <class Enum, class Member>
  void choice(const std::string& name, Member member, const Names<Enum>& names,
              const std::string& meaning) {
    std::vector<std::string> texts;
    for (const auto& [text, value] : names) texts.push_back(text);
    const auto of = field<Enum>(member);
    keys_.push_back(choice_key(
        prefix_ + name, texts,
        [of, names](const Scenario& s) {
          std::size_t i = 0;
          while (i < names.size() && names[i].second != of.read(s)) ++i;
          return i;
        },
        [of, names](Scenario& s, std::size_t i) { of.write(s) = names[i].second; }, meaning));
  }
  /// One of several texts, where the text is the value.
  template <class Member>
  void one_of(const std::string& name, Member member, const std::vector<std::string>& texts,
              const std::string& meaning) {
    Names<std::string> names;
    for (const std::string& text : texts) names.emplace_back(text, text);
    choice<std::string>(name, member, names, meaning);
  }

  /// Keys that were collected elsewhere; their names are whole already.
  void append(std::vector<ScenarioKey> keys) {
    for (ScenarioKey& key : keys) keys_.push_back(std::move(key));
  }
  std::vector<ScenarioKey> take() { return std::move(keys_); }

 private:
  template <class T, class Member>
  ScenarioField<T> field(Member member) const {
    return {
        [of = settings_, member](const Scenario& s) -> const T& {
          return std::invoke(member, of.read(s));
        },
        [of = settings_, member](Scenario& s) -> T& { return std::invoke(member, of.write(s)); }};
  }

  std::string prefix_;
  ScenarioField<Settings> settings_;
  std::vector<ScenarioKey> keys_;
};

// A member of a member.
#define TETHER_MEMBER(member) ([](auto& settings) -> auto& { return settings.member; })

}  // namespace tether
