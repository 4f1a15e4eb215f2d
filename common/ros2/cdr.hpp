#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace tether {

/// Encodes as ROS 2 does on the wire and in bags: OMG's Common Data Representation, XCDR version 1,
/// little-endian. The first four bytes say so (encapsulation 0x0001, options 0). Behind them each
/// number lies at a multiple of its own size, a text is its length with the final NUL, then both,
/// and a sequence is its number of elements, then they; arrays of fixed size have no number.
/// (DDS-XTypes 1.3, section 7.4.1; npm's @foxglove/rosmsg2-serialization reads it, in a test.)
class CdrWriter {
 public:
  std::string bytes = std::string("\x00\x01\x00\x00", kHeader);

  void put(std::int32_t x) { little_endian(static_cast<std::uint32_t>(x)); }
  void put(std::uint32_t x) { little_endian(x); }
  void put(float x) { little_endian(std::bit_cast<std::uint32_t>(x)); }
  void put(double x) { little_endian(std::bit_cast<std::uint64_t>(x)); }
  void put(std::string_view text) {
    little_endian(static_cast<std::uint32_t>(text.size() + 1));
    bytes += text;
    bytes += '\0';
  }
  /// Begins a sequence; its elements follow.
  void sequence(std::size_t count) { little_endian(static_cast<std::uint32_t>(count)); }

 private:
  static constexpr std::size_t kHeader = 4;

  template <std::unsigned_integral T>
  void little_endian(T x) {
    while ((bytes.size() - kHeader) % sizeof(T) != 0) bytes += '\0';
    for (std::size_t i = 0; i < sizeof(T); ++i) bytes += static_cast<char>(x >> (8 * i));
  }
};

}  // namespace tether
