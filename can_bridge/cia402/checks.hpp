#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "can_bridge/cia402/config.hpp"

namespace tether {

/// Where the parts of a Cia402Config stand in their file; lists run parallel to the config's.
struct Cia402Source {
  std::string file;
  std::uint32_t drives_line = 1;
  std::array<std::uint32_t, 2> axis_lines{1, 1};
  std::vector<std::uint32_t> setup_lines;
  std::vector<std::uint32_t> watchdog_lines;
  std::vector<std::uint32_t> pdo_lines;
};

/// Refuses a CiA 402 drivetrain that reads well and cannot work, or not safely: values that no PDO
/// carries, drives that nothing stops when the bridge dies, time-outs that trip by themselves.
/// Throws UsageError with file and line.
void check_cia402(const Cia402Config& config, const Cia402Source& source);

/// Whether `value` in `object` lets a drive run on without its master: 0x6007 (abort connection
/// option, also of a second axis) = 0.
bool is_no_reaction(const ObjectRef& object, std::int64_t value);

}  // namespace tether
