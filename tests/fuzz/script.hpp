#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace tether::fuzzing {

/// An input as a list of decisions: read from the front, zeros behind its end.
class Script {
 public:
  explicit Script(std::span<const std::uint8_t> input) : rest_(input) {}

  bool ended() const { return rest_.empty(); }

  template <class Number>
  Number number() {
    Number value{};
    const auto bytes = take(sizeof value);
    std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }
  std::uint8_t byte() { return number<std::uint8_t>(); }
  /// Below `count`.
  std::size_t choice(std::size_t count) { return byte() % count; }
  /// Takes at most the remaining bytes.
  std::span<const std::uint8_t> take(std::size_t size) {
    const auto taken = rest_.first(std::min(size, rest_.size()));
    rest_ = rest_.subspan(taken.size());
    return taken;
  }
  /// So many as its first byte says.
  std::span<const std::uint8_t> take_some() { return take(byte()); }

 private:
  std::span<const std::uint8_t> rest_;
};

/// Fills the fields of an LCM message, as a visitor of them: well-formed, but with odd values.
/// Names are mostly among `words`, numbers mostly zero or small.
class MessageFiller {
 public:
  MessageFiller(Script& script, const std::vector<std::string>& words)
      : script_(script), words_(words) {}

  template <class Field>
  void operator()(std::string_view name, Field& field) {
    if constexpr (std::is_array_v<Field>) {
      for (auto& element : field) (*this)(name, element);
    } else if constexpr (std::is_same_v<Field, std::string>) {
      const std::size_t which = script_.choice(words_.size() + 1);
      field = which < words_.size() ? words_[which] : text(script_.take_some());
    } else if (name == "count") {
      field = static_cast<Field>(script_.choice(4));
    } else if (const std::uint8_t how = script_.byte(); how >= 0xC0) {
      field = script_.number<Field>();
    } else if (how >= 0x40) {
      field = static_cast<Field>(script_.number<std::int8_t>());
    }
  }
  template <class Element, class Count>
  void operator()(std::string_view name, std::vector<Element>& elements, Count count) {
    elements.resize(static_cast<std::size_t>(count));
    for (auto& element : elements) (*this)(name, element);
  }

 private:
  static std::string text(std::span<const std::uint8_t> bytes) {
    return {bytes.begin(), bytes.end()};
  }

  Script& script_;
  const std::vector<std::string>& words_;
};

template <class LcmType>
LcmType filled(Script& script, const std::vector<std::string>& words) {
  LcmType message{};
  visit_fields(message, MessageFiller(script, words));
  return message;
}

}  // namespace tether::fuzzing
