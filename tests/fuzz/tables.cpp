#include <cmath>
#include <sstream>

#include "controller/laws/pid_law.hpp"
#include "netem/stages/delay_law.hpp"
#include "netem/stages/kinds.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/support/folder.hpp"

namespace tether::fuzzing {

/// The tables that settings name: look-aheads and delays.
void try_input(std::span<const std::uint8_t> input) {
  std::istringstream in(text_of(input));
  takes([&] {
    const TauTable table = TauTable::read(in, "tau.csv");
    for (const double prr : {0.0, 0.45, 1.0}) {
      must(std::isfinite(table.tau_s(prr, 30.0)), "there is a look-ahead for every network");
    }
  });
  static const test::Folder folder;
  JitterSettings jitter;
  jitter.law = "table";
  jitter.file = folder.file("delays.txt", text_of(input));
  takes([&] {
    const std::vector<double> table_ms = load_delay_table(jitter);
    must(std::ranges::is_sorted(table_ms), "quantiles ascend");
    const DelayLaw law(jitter, table_ms);
    for (const double z : {-9.0, 0.0, 9.0})
      must(std::isfinite(law.at_score(z)), "delays are finite");
  });
}

}  // namespace tether::fuzzing
