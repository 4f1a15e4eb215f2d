#include "netem/models/trace.hpp"

#include <sstream>

#include "tests/fuzz/fuzz.hpp"

namespace tether::fuzzing {

void try_input(std::span<const std::uint8_t> input) {
  std::istringstream in(text_of(input));
  takes([&] {
    const Trace trace = read_trace(in, "trace.csv");
    must(!trace.rows.empty(), "a trace has a row");
    Duration last{-1};
    for (const auto& row : trace.rows) {
      must(row.since_first > last, "time goes on from row to row");
      must(row.delay >= Duration{0}, "no delay is negative");
      must(row.prr >= 0.0 && row.prr <= 1.0, "a reception ratio is a share");
      must(!trace.of_fates || row.prr == 0.0 || row.prr == 1.0, "a packet is lost or not");
      last = row.since_first;
    }
    must(trace.rows.front().since_first == Duration{0}, "a trace begins with its first row");
  });
}

}  // namespace tether::fuzzing
