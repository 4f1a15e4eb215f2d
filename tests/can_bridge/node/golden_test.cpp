#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <tether/drive_request_t.hpp>
#include <tether/drivetrain_state_t.hpp>
#include <tether/twist_t.hpp>
#include <vector>

#include "can_bridge/bus/in_process_can.hpp"
#include "can_bridge/drivetrain/can_settings.hpp"
#include "can_bridge/node/can_bridge_node.hpp"
#include "can_bridge/node/can_drive_node.hpp"
#include "tests/can_bridge/node/bridge_fakes.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/support/virtual_world.hpp"

// A stored log of candump's format, two_node_cia402.log: cold start, a short drive and the
// end of it with the shipped drivetrain. What its drives said, played to the bridge at the same
// times, must make it say the same again, frame by frame. Where that is meant to change:
//   TETHER_GOLDEN_RECORD=tests/can_bridge/node/two_node_cia402.log
//   build/release/tests/can_golden_test
// records it again, with the emulated drives; look at the difference before it becomes the truth.

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::FakePort;
using test::Seen;
using test::VirtualWorld;
using ::testing::ElementsAre;

const std::string kStored = in_source("/tests/can_bridge/node/two_node_cia402.log");
constexpr Duration kCycle = std::chrono::milliseconds{20};
const Instant kEnd = at_s(5.5);

struct Logged {
  Instant when;
  CanFrame frame;
};
using Log = std::vector<Logged>;

/// Frames in candump's format: NMT, SYNC, setpoints, SDO requests and the bridge's heartbeat are
/// its.
bool is_of_bridge(const CanFrame& frame) {
  const std::uint32_t function = frame.id & ~0x7FU;
  return frame.id == 0x000 || frame.id == 0x080 || frame.id == 0x77F || function == 0x200 ||
         function == 0x600;
}

std::string to_text(const CanFrame& frame) {
  std::string text = fmt::format("{:03X}#", frame.id);
  for (const std::uint8_t byte : frame.bytes()) text += fmt::format("{:02X}", byte);
  return text;
}

void write(const std::string& file, const Log& log) {
  std::ofstream out(file);
  for (const auto& [when, frame] : log) {
    const std::int64_t us = to_utime(when);
    out << fmt::format("({:010}.{:06}) vcan0 {}\n", us / 1'000'000, us % 1'000'000, to_text(frame));
  }
}

Log read(const std::string& file) {
  Log log;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    long long s = 0, us = 0;
    unsigned id = 0;
    int data = 0;
    if (std::sscanf(line.c_str(), "(%lld.%lld) vcan0 %x#%n", &s, &us, &id, &data) != 3) break;
    std::vector<std::uint8_t> bytes;
    for (auto i = static_cast<std::size_t>(data); i + 1 < line.size(); i += 2) {
      bytes.push_back(static_cast<std::uint8_t>(std::stoi(line.substr(i, 2), nullptr, 16)));
    }
    log.push_back({from_utime(s * 1'000'000 + us), CanFrame::make(id, bytes)});
  }
  return log;
}

/// The bridge's frames of each control cycle; in which order they won the bus says nothing.
std::map<std::int64_t, std::multiset<std::string>> by_cycle(const Log& log) {
  std::map<std::int64_t, std::multiset<std::string>> cycles;
  for (const auto& [when, frame] : log) {
    if (is_of_bridge(frame)) cycles[(when - kStart) / kCycle].insert(to_text(frame));
  }
  return cycles;
}

Scenario scenario() {
  return load_scenario(in_source("/scenarios/hil_vcan.toml"), {"can.wheels=model", "run.lead_s=0"});
}

/// A controller and an operator with their minds made up.
struct Run : VirtualWorld {
  Run() : config(load_drivetrain(scenario().get<CanSettings>().drivetrain_file)) {
    collect("CAN/STATE", states);
    std::int64_t seq = 0;
    for (Instant t = at_ms(103); t < kEnd; t += std::chrono::milliseconds{50}) {
      twist_t m{};
      m.pose_utime = -1;
      m.utime = to_utime(t);
      m.seq = seq++;
      m.v_mps = t > at_s(3.4) && t < at_s(4.4) ? 0.5 : 0.0;
      m.omega_radps = m.v_mps * 0.6;
      publish_at(t, "AGV/CMD_VEL", m);
    }
    request(at_ms(2507), 0, drive_request_t::ARM);
    request(at_ms(5007), 1, drive_request_t::DISARM);
  }
  void request(Instant when, std::int64_t seq, std::int32_t what) {
    drive_request_t m{};
    m.utime = to_utime(when);
    m.seq = seq;
    m.request = what;
    publish_at(when, "CAN/REQUEST", m);
  }
  std::vector<std::string> state_names() const {
    std::vector<std::string> names;
    for (const auto& [when, m] : states) {
      if (names.empty() || names.back() != m.state_name) names.push_back(m.state_name);
    }
    return names;
  }

  DrivetrainConfig config;
  std::vector<Seen<drivetrain_state_t>> states;
};

Log record() {
  Run run;
  Log log;
  InProcessCan can(run.loop, scenario().get<CanSettings>().bit_rate_bps);
  can.on_any_frame([&](const CanFrame& frame) { log.push_back({run.loop.now(), frame}); });
  CanDriveNode drives(scenario(), run.config, run.loop, run.bus, can.add_port());
  CanBridgeNode bridge(scenario(), run.config, run.loop, run.bus, can.add_port());
  run.loop.run_until(kEnd);
  return log;
}

/// The bridge with the drives' side of a log.
struct Replay : Run {
  explicit Replay(const Log& log) {
    port.on_send = [this] { sent.push_back({loop.now(), port.sent.back()}); };
    CanBridgeNode bridge(scenario(), config, loop, bus, port);
    for (const Logged& logged : log) {
      if (is_of_bridge(logged.frame)) continue;
      loop.at(logged.when, Priority::delivery,
              [this, frame = logged.frame](Instant) { port.frame_handler(frame); });
    }
    loop.run_until(kEnd);
  }
  FakePort port;
  Log sent;
};

Log stored() {
  if (const char* file = std::getenv("TETHER_GOLDEN_RECORD")) {
    write(file, record());
    return read(file);
  }
  return read(kStored);
}

TEST(GoldenLog, TheDrivesSideOfTheStoredLogMakesTheBridgeSayTheSameAgain) {
  const Log log = stored();
  ASSERT_GT(log.size(), 1000U) << kStored;
  const Replay replay(log);
  EXPECT_THAT(replay.state_names(),
              ElementsAre("starting", "disarmed", "arming", "armed", "stopping", "disarmed"));
  const auto expected = by_cycle(log), got = by_cycle(replay.sent);
  for (std::int64_t cycle = 0; cycle < (kEnd - kStart) / kCycle; ++cycle) {
    const auto want = expected.find(cycle), have = got.find(cycle);
    ASSERT_EQ(want == expected.end(), have == got.end()) << "cycle " << cycle;
    if (want == expected.end()) continue;
    ASSERT_EQ(want->second, have->second) << "at " << to_seconds(cycle * kCycle) << " s";
  }
}

TEST(GoldenLog, HoldsAColdStartAndADriveOfBothWheels) {
  std::set<std::string> nmt;
  std::map<std::uint32_t, std::int32_t> fastest;
  for (const auto& [when, frame] : stored()) {
    if (frame.id == 0x000) nmt.insert(to_text(frame));
    if (frame.id != 0x201 && frame.id != 0x202) continue;
    auto& units = fastest[frame.id];
    units = std::max(units, std::abs(test::setpoint_mmps(frame)));
  }
  for (const char* order : {"000#8101", "000#8102", "000#0101", "000#0102"}) {
    EXPECT_TRUE(nmt.contains(order)) << order;
  }
  // 0.5 m/s and 0.3 rad/s on wheels of 0.4 m, 1.2 m apart; 12000 units a turn.
  EXPECT_EQ(fastest[0x201], 1528);
  EXPECT_EQ(fastest[0x202], 3247);
}

TEST(GoldenLog, AWatchdogThatReadsBackOtherwiseIsRefused) {
  Log log = stored();
  int changed = 0;
  for (auto& [when, frame] : log) {
    if (to_text(frame) != "581#43161001FA007F00") continue;
    frame.data[4] = 0;
    ++changed;
  }
  ASSERT_GT(changed, 0) << "0x1016:1 of node 1 was not read back";
  const Replay replay(log);
  EXPECT_THAT(replay.state_names(), ElementsAre("starting", "refused"));
}

}  // namespace
}  // namespace tether
