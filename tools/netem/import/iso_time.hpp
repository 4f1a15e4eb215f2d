#pragma once

#include <optional>
#include <string_view>

namespace tether {

/// A time in ISO 8601, as seconds since 1970, to the nanosecond: 2026-11-26T15:04:05, with a blank
/// for the T, with decimals behind a point or a comma, and with a zone: Z, +01:00, +0100 or +01;
/// without one it is UTC. Nothing if it is not such a time.
std::optional<long double> from_iso_time(std::string_view text);

}  // namespace tether
