#pragma once

#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "netem/models/trace.hpp"
#include "tools/netem/import.hpp"

namespace tether {

inline std::string refusal(const std::function<void()>& act) {
  try {
    act();
  } catch (const UsageError& error) {
    return error.what();
  }
  return "accepted";
}

/// The trace as the channel reads it.
inline Trace trace_of(const Imported& imported) {
  std::istringstream in(to_trace_csv(imported, "test"));
  return read_trace(in, "t.csv");
}

inline std::vector<double> times(const Imported& imported) {
  std::vector<double> all;
  for (const auto& row : imported.rows) all.push_back(row.time_s);
  return all;
}

inline std::vector<double> delays(const Trace& trace) {
  std::vector<double> all;
  for (const auto& row : trace.rows) all.push_back(to_seconds(row.delay) * 1e3);
  return all;
}

inline std::vector<double> prrs(const Trace& trace) {
  std::vector<double> all;
  for (const auto& row : trace.rows) all.push_back(row.prr);
  return all;
}

}  // namespace tether
