#include <gtest/gtest.h>

#include <boost/crc.hpp>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

// Who has no scanner has the runs of before there were scanners, to the last bit.

namespace tether {
namespace {

/// Digest of all channels' names and messages, one after the other, of the first 10 s.
std::pair<std::size_t, std::uint32_t> digest_of_run(const std::string& scenario) {
  ClosedLoop loop(load_scenario(in_source("/scenarios/") + scenario, {"run.duration_s=10"}));
  std::vector<std::uint8_t> all;
  loop.bus().subscribe(".*", kDeepQueue, [&all](const Message& message) {
    all.insert(all.end(), message.channel.begin(), message.channel.end());
    all.insert(all.end(), message.bytes.begin(), message.bytes.end());
  });
  loop.run();
  boost::crc_32_type crc;
  crc.process_bytes(all.data(), all.size());
  return {all.size(), crc.checksum()};
}

// Size and checksum of the logs that the last commit before scanners wrote, c2e6eda ("Open the runs
// behind a report's points in the viewer"): `tether run SCENARIO --set run.duration_s=10`, and
// zlib's crc32 of each event's channel and message in turn. Its log files were byte for byte those
// of today (0x0178f513 and 0x31ddc759) as long as the metrics in SIM/TRUTH were of each step, and
// still are with kMetricsPeriod (sim_node.cpp) at a step. On a processor without FMA glibc's sines
// differ in the last bit, and so would these.
TEST(ScannerOff, RunsAreThoseOfBeforeThereWasAScanner) {
  EXPECT_EQ(digest_of_run("paper.toml"),
            (std::pair<std::size_t, std::uint32_t>{133'565, 0xf3f913ee}));
  EXPECT_EQ(digest_of_run("warehouse_lap.toml"),
            (std::pair<std::size_t, std::uint32_t>{207'285, 0x50c916c2}));
}

}  // namespace
}  // namespace tether
