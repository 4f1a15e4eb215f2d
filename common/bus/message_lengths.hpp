#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

namespace tether {

/// Walks over an encoded message without decoding it, as a visitor of its type's fields, and notes
/// whether every length in it is possible within the bytes that follow. LCM 1.3.1's generated code
/// trusts lengths from the network: a string length of −2³¹ makes it copy 2 GiB from beyond the
/// message, and a large array count allocates the array before looking at the bytes. Zeros within a
/// string would be lost when it is encoded again, as LCM has C's strings.
class LengthCheck {
 public:
  explicit LengthCheck(std::span<const std::uint8_t> bytes) : rest_(bytes) { skip(kFingerprint); }

  bool ok() const { return ok_; }

  /// Reads a field if it is an integer, because that may be an array's count, else skips it.
  template <class Field>
  void operator()(const char* name, Field& field) {
    if constexpr (std::is_array_v<Field>) {
      for (auto& element : field) (*this)(name, element);
    } else if constexpr (std::is_same_v<Field, std::string>) {
      skip_string();
    } else if constexpr (std::is_integral_v<Field>) {
      field = read<Field>();
    } else {
      skip(sizeof field);
    }
  }

  template <class Element, class Count>
  void operator()(const char* name, const std::vector<Element>&, Count count) {
    ok_ = ok_ && count >= 0;
    Element element{};
    for (Count i = 0; ok_ && i < count; ++i) (*this)(name, element);
  }

 private:
  static constexpr std::size_t kFingerprint = 8;

  void skip(std::size_t bytes) {
    ok_ = ok_ && bytes <= rest_.size();
    if (ok_) rest_ = rest_.subspan(bytes);
  }
  void skip_string() {
    const auto size = read<std::int32_t>();  // with the closing zero
    const auto text = rest_;
    ok_ = ok_ && size >= 1;
    if (ok_) skip(static_cast<std::size_t>(size));
    ok_ = ok_ && std::find(text.begin(), text.begin() + size, 0) == text.begin() + (size - 1);
  }
  template <class Integer>
  Integer read() {
    const auto field = rest_;
    skip(sizeof(Integer));
    std::uint64_t value = 0;
    for (std::size_t i = 0; ok_ && i < sizeof(Integer); ++i) value = value << 8 | field[i];
    return static_cast<Integer>(value);
  }

  std::span<const std::uint8_t> rest_;
  bool ok_ = true;
};

/// Whether generated code may decode `bytes` as LcmType. Nothing to check in fixed-size types.
template <class LcmType>
bool lengths_fit([[maybe_unused]] std::span<const std::uint8_t> bytes) {
  if constexpr (std::is_trivially_copyable_v<LcmType>) {
    return true;
  } else {
    LcmType counts{};
    LengthCheck check(bytes);
    visit_fields(counts, check);
    return check.ok();
  }
}

}  // namespace tether
