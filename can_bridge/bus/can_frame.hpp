#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>
#include <span>

namespace tether {

/// One classic CAN 2.0 data or remote frame. Error frames do not count as frames: a CanPort turns
/// them into its state.
struct CanFrame {
  std::uint32_t id = 0;   ///< 11 bits, 29 if `extended`; no flag bits
  std::uint8_t size = 0;  ///< 0…8 data bytes
  std::array<std::uint8_t, 8> data{};
  bool extended = false;
  bool remote = false;

  static CanFrame make(std::uint32_t id, std::span<const std::uint8_t> bytes);
  static CanFrame make(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) {
    return make(id, std::span(bytes.begin(), bytes.size()));
  }
  std::span<const std::uint8_t> bytes() const { return {data.data(), size}; }
  bool operator==(const CanFrame&) const = default;
};

/// Which identifiers a receiver wants: data frames of 11 bits, or of 29 if `extended`, whose id
/// agrees with `id` in the bits of `mask`. Remote frames never pass.
struct CanFilter {
  std::uint32_t id = 0;
  std::uint32_t mask = 0x7FF;
  bool extended = false;

  bool passes(const CanFrame& f) const {
    return f.extended == extended && !f.remote && (f.id & mask) == (id & mask);
  }
};

}  // namespace tether
