#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace tether {

/// Writes values as MCAP serialises them ("Serialization", mcap.dev/spec): little-endian integers,
/// and texts, arrays and maps with their length in bytes before them.
class McapBytes {
 public:
  std::string bytes;

  void u8(std::uint8_t x) { bytes += static_cast<char>(x); }
  void u16(std::uint16_t x) { little_endian(x, 2); }
  void u32(std::uint32_t x) { little_endian(x, 4); }
  void u64(std::uint64_t x) { little_endian(x, 8); }
  void raw(std::string_view text) { bytes += text; }
  void text(std::string_view text) {
    u32(static_cast<std::uint32_t>(text.size()));
    raw(text);
  }

  /// An array or a map: `write()` writes its elements, the length in front comes after.
  template <class Write>
  void sized(Write write) {
    const std::size_t at = bytes.size();
    u32(0);
    write();
    put(at, bytes.size() - at - 4, 4);
  }

  /// A record: opcode, u64 length, content.
  template <class Write>
  void record(std::uint8_t opcode, Write write) {
    u8(opcode);
    const std::size_t at = bytes.size();
    u64(0);
    write();
    put(at, bytes.size() - at - 8, 8);
  }

 private:
  void little_endian(std::uint64_t x, int size) {
    char digits[8];
    for (int i = 0; i < size; ++i) digits[i] = static_cast<char>(x >> (8 * i));
    bytes.append(digits, static_cast<std::size_t>(size));
  }
  void put(std::size_t at, std::uint64_t x, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) bytes[at + i] = static_cast<char>(x >> (8 * i));
  }
};

}  // namespace tether
