#include "netem/models/trace.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>

#include "common/base/csv_table.hpp"
#include "common/base/errors.hpp"
#include "common/base/file_store.hpp"
#include "common/base/input_file.hpp"

namespace tether {
namespace {

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

std::optional<Duration> read_delay(const CsvTable& table, bool is_lost) {
  // A lost packet has no delay: logs leave it empty.
  if (!table.has("delay_ms") || (is_lost && table.cell("delay_ms").empty())) return std::nullopt;
  const double delay_ms = table.number("delay_ms");
  if (delay_ms < 0.0 || delay_ms > Trace::kLongestDelay_ms) table.refuse("delay_ms", "in [0, 1e9]");
  return from_seconds(delay_ms * 1e-3);
}

/// Gives the rows that have no delay one between their neighbours'; `known`: the rows that have
/// one, in order.
void fill_delays(std::vector<Trace::Row>& rows, const std::vector<std::size_t>& known) {
  if (known.empty()) return;
  std::size_t after = 0;  // in known: the first that is not before the row
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (after < known.size() && known[after] < i) ++after;
    if (after < known.size() && known[after] == i) continue;
    const Trace::Row& left = rows[known[after == 0 ? 0 : after - 1]];
    const Trace::Row& right = rows[known[std::min(after, known.size() - 1)]];
    rows[i].delay = left.delay;
    if (left.since_first == right.since_first) continue;
    const double share = to_seconds(rows[i].since_first - left.since_first) /
                         to_seconds(right.since_first - left.since_first);
    rows[i].delay += from_seconds(share * to_seconds(right.delay - left.delay));
  }
}

}  // namespace

Trace read_trace(std::istream& in, const std::string& name) {
  CsvTable table(in, name);
  Trace trace;
  trace.of_fates = table.has("lost");
  if (!table.has("time_s"))
    table.fail(
        "the header must name a column time_s (tether netem import makes a trace of other tables)");
  if (!table.has("delay_ms") && !table.has("prr") && !table.has("lost")) {
    table.fail("the header must name one of the columns delay_ms, prr and lost");
  }
  if (table.has("prr") && table.has("lost")) {
    table.fail("the header names both prr and lost; keep one of them");
  }
  std::vector<std::size_t> with_delay;
  while (table.next_row()) {
    const double time_s = table.number("time_s");
    if (trace.rows.empty()) trace.first_s = time_s;
    if (std::abs(time_s - trace.first_s) > Trace::kLongest_s) {
      table.refuse("time_s", "within 1e9 s of the first row's");
    }
    const double prr = read_prr(table, trace.of_fates);
    const std::optional<Duration> delay = read_delay(table, prr == 0.0);
    const Trace::Row row{from_seconds(time_s - trace.first_s), delay.value_or(Duration{0}), prr};
    if (!trace.rows.empty() && row.since_first <= trace.rows.back().since_first) {
      table.refuse("time_s", "later than the row's before, by 1 ns at least");
    }
    if (delay) with_delay.push_back(trace.rows.size());
    trace.rows.push_back(row);
  }
  if (trace.rows.empty()) table.fail("no rows below the header");
  fill_delays(trace.rows, with_delay);
  return trace;
}

Trace load_trace(const std::string& file) {
  std::ifstream in = open_input(file, "the trace", kMostTableBytes);
  return read_trace(in, file);
}

std::shared_ptr<const Trace> kept_trace(const std::string& file) {
  static FileStore<Trace> store(load_trace);
  return store.get(file);
}

}  // namespace tether
