#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>

#include "can_bridge/drivetrain_config.hpp"

/// How drivetrain files write the objects of a drive.
namespace tether {

inline constexpr const char* kObjectForm =
    "an object such as \"0x60FF:00 i32\" (index from 0x1000, subindex, type: i8, u8, i16, u16, i32 "
    "or u32)";

/// "0x60FF:00 i32"; the subindex is hexadecimal, as in manuals. nullopt for anything else.
std::optional<ObjectRef> parse_object(std::string_view text);

/// The smallest and the largest value that fits.
std::pair<std::int64_t, std::int64_t> object_limits(const ObjectRef& object);

}  // namespace tether
