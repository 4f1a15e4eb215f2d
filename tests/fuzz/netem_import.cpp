#include <cmath>
#include <sstream>

#include "netem/models/trace.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tools/netem/import.hpp"

namespace tether::fuzzing {
namespace {

/// Checks that the import is a trace, with and without its gaps.
void must_be_a_trace(Imported imported) {
  must(!imported.rows.empty(), "there is a row");
  for (const Imported::Row& row : imported.rows) {
    must(std::isfinite(row.time_s), "each row has a time");
    must(row.prr >= 0.0 && row.prr <= 1.0, "a reception ratio is a share");
    must(!row.delay_ms || *row.delay_ms >= 0.0, "no delay is negative");
  }
  const std::size_t before = imported.rows.size();
  apply({GapRule::Meaning::lost, 0.0}, imported, "measured");
  must(imported.rows.size() >= before, "gaps only add rows");
  std::istringstream written(to_trace_csv(imported, "measured"));
  must(takes([&] { read_trace(written, "trace.csv"); }), "what is imported can be read");
}

}  // namespace

/// Measurements of other tools: tables, and what ping and iperf3 write.
void try_input(std::span<const std::uint8_t> input) {
  const std::string text = text_of(input);
  takes([&] { format_of_measurement(text); });
  takes([&] {
    std::istringstream in(text);
    must_be_a_trace(import_csv(in, "measured.csv", {}));
  });
  takes([&] {
    std::istringstream in(text);
    must_be_a_trace(import_ping(in, "ping.txt", 1.0));
  });
  takes([&] { must_be_a_trace(import_iperf3(text, "iperf3.txt")); });
}

}  // namespace tether::fuzzing
