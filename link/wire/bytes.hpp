#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

namespace tether::link {

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

/// Appends numbers, the most significant byte first.
class Writer {
 public:
  /// `out` must outlive the writer.
  explicit Writer(Bytes& out) : out_(out) {}

  template <class Number>
  Writer& number(Number value) {
    auto bits = static_cast<std::make_unsigned_t<Number>>(value);
    for (std::size_t i = sizeof bits; i-- > 0;) {
      out_.push_back(static_cast<std::uint8_t>(bits >> (8 * i)));
    }
    return *this;
  }
  Writer& bytes(ByteView bytes) {
    out_.insert(out_.end(), bytes.begin(), bytes.end());
    return *this;
  }

 private:
  Bytes& out_;
};

/// Reads what a Writer wrote. Beyond the end everything is zero or empty, and ok() false.
class Reader {
 public:
  explicit Reader(ByteView bytes) : rest_(bytes) {}

  template <class Number>
  Number number() {
    std::make_unsigned_t<Number> bits = 0;
    for (const std::uint8_t byte : take(sizeof bits)) {
      bits = static_cast<std::make_unsigned_t<Number>>(std::uint64_t{bits} << 8 | byte);
    }
    return static_cast<Number>(bits);
  }
  ByteView take(std::size_t size) {
    if (size > rest_.size()) {
      ok_ = false;
      rest_ = {};
      return {};
    }
    const ByteView taken = rest_.first(size);
    rest_ = rest_.subspan(size);
    return taken;
  }
  /// The next bytes as an array.
  template <class Array>
  Array array() {
    Array out{};
    const ByteView taken = take(out.size());
    std::copy(taken.begin(), taken.end(), out.begin());
    return out;
  }
  ByteView rest() const { return rest_; }
  /// Nothing was asked for that is not there.
  bool ok() const { return ok_; }
  bool ended() const { return ok_ && rest_.empty(); }

 private:
  ByteView rest_;
  bool ok_ = true;
};

}  // namespace tether::link
