#include <sstream>

#include "tests/fuzz/fuzz.hpp"
#include "tools/netem/fit.hpp"

namespace tether::fuzzing {

/// Input that channels are fitted to: captures in pcap format, and tables.
void try_input(std::span<const std::uint8_t> input) {
  std::istringstream capture(text_of(input)), table(text_of(input));
  takes<std::runtime_error>([&] { read_fit_pcap(capture, "capture.pcap", ""); });
  takes<std::runtime_error>([&] { read_fit_csv(table, "packets.csv"); });
}

}  // namespace tether::fuzzing
