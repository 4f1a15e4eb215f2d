#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <tether/drive_request_t.hpp>

namespace tether {

/// Request of a page to a drivetrain: {"request": "ARM"}, by the constant's name in drive_request_t
/// or its number. Throws UsageError that says what is wrong.
std::int32_t parse_operator_request(std::string_view json);

}  // namespace tether
