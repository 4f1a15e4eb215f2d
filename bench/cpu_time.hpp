#pragma once

#include <fmt/format.h>
#include <sys/types.h>
#include <unistd.h>

#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

namespace tether::bench {

/// Seconds of CPU time that a process has used so far, user and system, all threads (proc(5)).
inline double cpu_seconds(pid_t pid) {
  const std::string path = fmt::format("/proc/{}/stat", pid);
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) throw std::runtime_error("cannot read " + path);
  std::istringstream fields(line.substr(line.rfind(')') + 1));
  std::string skipped;
  for (int field = 3; field < 14; ++field) fields >> skipped;
  double user = 0.0, system = 0.0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

/// Whether this kernel charges CPU time by whole ticks (User-Mode Linux: 10 ms), so that it means
/// nothing for a process that runs for less than a tick at a time.
inline bool charges_whole_ticks() {
  std::ifstream file("/proc/self/schedstat");  // time on the CPU, ns; absent: unknown
  long long time_ns = 1;
  file >> time_ns;
  return time_ns % 1'000'000 == 0;
}

}  // namespace tether::bench
