#pragma once

#include <cstdint>
#include <fstream>
#include <string>

namespace tether {

// The largest file of each kind that is read. What exists is far smaller: the bounds are there so
// that a wrong file ends with an error, not with the memory.

/// TOML: scenarios, experiments, drivetrains.
inline constexpr std::uintmax_t kMostTomlBytes = std::uintmax_t{4} << 20;
/// Tables, which are kept in memory: traces, waypoints, delays, look-aheads, maps, CSV to fit.
inline constexpr std::uintmax_t kMostTableBytes = std::uintmax_t{256} << 20;
/// Recordings, which are read record by record: LCM logs and pcap.
inline constexpr std::uintmax_t kMostRecordingBytes = std::uintmax_t{1} << 40;
/// SQLite databases of sweeps.
inline constexpr std::uintmax_t kMostDatabaseBytes = std::uintmax_t{1} << 40;

/// Throws UsageError that names the file unless it is a regular one of `most_bytes` at most. A
/// device or a pipe might never end, and opening a pipe may wait for ever. `what` is the file's
/// kind, such as "the trace".
void check_input(const std::string& file, const std::string& what, std::uintmax_t most_bytes);

/// Opens it after check_input(); throws UsageError with the system's reason if it cannot.
std::ifstream open_input(const std::string& file, const std::string& what,
                         std::uintmax_t most_bytes);

/// All of a file.
std::string read_input(const std::string& file, const std::string& what, std::uintmax_t most_bytes);

}  // namespace tether
