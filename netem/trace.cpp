#include "netem/trace.hpp"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "common/errors.hpp"
#include "netem/csv_table.hpp"

namespace tether {
namespace {

// Bounds that keep sums of times within the range of nanoseconds.
constexpr double kLongest_s = 1e9;
constexpr double kLongestDelay_ms = 1e9;

double read_prr(const CsvTable& table, bool of_fates) {
  if (of_fates) {
    const auto lost = table.cell("lost");
    if (lost != "0" && lost != "1") table.refuse("lost", "0 or 1");
    return lost == "1" ? 0.0 : 1.0;
  }
  if (!table.has("prr")) return 1.0;
  const double prr = table.number("prr");
  if (prr < 0.0 || prr > 1.0) table.refuse("prr", "in [0, 1]");
  return prr;
}

Duration read_delay(const CsvTable& table, bool is_lost) {
  // A lost packet has no delay: logs leave it empty.
  if (!table.has("delay_ms") || (is_lost && table.cell("delay_ms").empty())) return Duration{0};
  const double delay_ms = table.number("delay_ms");
  if (delay_ms < 0.0 || delay_ms > kLongestDelay_ms) table.refuse("delay_ms", "in [0, 1e9]");
  return from_seconds(delay_ms * 1e-3);
}

}  // namespace

Trace read_trace(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  Trace trace;
  trace.of_fates = table.has("lost");
  if (!table.has("time_s")) table.fail("the header must name a column time_s");
  if (!table.has("delay_ms") && !table.has("prr") && !table.has("lost")) {
    table.fail("the header must name one of the columns delay_ms, prr and lost");
  }
  if (table.has("prr") && table.has("lost")) {
    table.fail("the header names both prr and lost; keep one of them");
  }
  while (table.next_row()) {
    const double time_s = table.number("time_s");
    if (trace.rows.empty()) trace.first_s = time_s;
    if (std::abs(time_s - trace.first_s) > kLongest_s) {
      table.refuse("time_s", "within 1e9 s of the first row's");
    }
    const double prr = read_prr(table, trace.of_fates);
    const Trace::Row row{from_seconds(time_s - trace.first_s), read_delay(table, prr == 0.0), prr};
    if (!trace.rows.empty() && row.since_first <= trace.rows.back().since_first) {
      table.refuse("time_s", "later than the row's before, by 1 ns at least");
    }
    trace.rows.push_back(row);
  }
  if (trace.rows.empty()) table.fail("no rows below the header");
  return trace;
}

Trace load_trace(const std::string& file) {
  if (std::filesystem::is_directory(file)) throw UsageError(fmt::format("{} is a directory", file));
  std::ifstream in(file);
  if (!in) throw UsageError(fmt::format("cannot open the trace {}", file));
  return read_trace(in, file);
}

}  // namespace tether
