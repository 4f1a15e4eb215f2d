#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace tether {

/// One entry of a CANopen object dictionary.
struct ObjectRef {
  std::uint16_t index = 0;
  std::uint8_t sub = 0;
  std::uint8_t bytes = 0;  ///< 1, 2 or 4
  bool is_signed = false;

  bool operator==(const ObjectRef&) const = default;
};

/// Whether index and subindex agree, whatever the types.
inline bool same_object(const ObjectRef& a, const ObjectRef& b) {
  return a.index == b.index && a.sub == b.sub;
}

/// "0x60FF:00 i32", as drivetrain files write it.
std::string to_string(const ObjectRef& object);

inline constexpr const char* kObjectForm =
    "an object such as \"0x60FF:00 i32\" (index from 0x1000, subindex, type: i8, u8, i16, u16, i32 "
    "or u32)";

/// "0x60FF:00 i32"; the subindex is hexadecimal, as in manuals. nullopt for anything else.
std::optional<ObjectRef> parse_object(std::string_view text);

/// The smallest and the largest value that fits.
std::pair<std::int64_t, std::int64_t> object_limits(const ObjectRef& object);

}  // namespace tether
