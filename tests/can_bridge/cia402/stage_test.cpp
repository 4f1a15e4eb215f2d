#include "can_bridge/cia402/stage.hpp"

#include <gtest/gtest.h>

#include "can_bridge/cia402/drives.hpp"
#include "tests/can_bridge/cia402/bench.hpp"

namespace tether::cia402 {
namespace {

using std::chrono::milliseconds;
using ::tether::test::two_nodes;

Instant stage_at(int ms) { return kStart + milliseconds(ms); }

TEST(StageClock, AStageBeginsWithTheFirstTickInIt) {
  StageClock clock;
  clock.enter(Stage::listening, "why");
  EXPECT_EQ(clock.elapsed(stage_at(500)), Duration{0});
  clock.mark(stage_at(500));
  clock.mark(stage_at(520));
  EXPECT_EQ(clock.elapsed(stage_at(540)), milliseconds(40));
  clock.restart(stage_at(540));
  EXPECT_EQ(clock.elapsed(stage_at(560)), milliseconds(20));
  EXPECT_EQ(clock.reason(), "why");
  clock.enter(Stage::securing);
  EXPECT_EQ(clock.elapsed(stage_at(900)), Duration{0});
  EXPECT_EQ(clock.reason(), "");
}

TEST(HeartbeatProducer, RoundsItsPeriodUpToTicks) {
  HeartbeatProducer heartbeat(0x7F, milliseconds(50));
  std::vector<int> sent_at_ms;
  for (int ms = 0; ms <= 200; ms += 20) {
    std::vector<CanFrame> out;
    heartbeat.tick(stage_at(ms), out);
    if (!out.empty()) sent_at_ms.push_back(ms);
  }
  EXPECT_EQ(sent_at_ms, (std::vector<int>{0, 60, 120, 180}));
  EXPECT_EQ(heartbeat.beats(), 4);
  heartbeat.restart_count();
  EXPECT_EQ(heartbeat.beats(), 0);
}

TEST(HeartbeatProducer, TakesATickThatComesALittleEarly) {
  HeartbeatProducer heartbeat(0x7F, milliseconds(60));
  std::vector<CanFrame> out;
  heartbeat.tick(stage_at(0), out);
  heartbeat.tick(stage_at(60) - std::chrono::microseconds(900), out);
  EXPECT_EQ(out.size(), 2U);
}

CanFrame heartbeat_of(std::uint8_t node, std::uint8_t state) {
  return CanFrame::make(canopen::kHeartbeat + node, {state});
}

TEST(Node, RemembersWhatItsHeartbeatsTell) {
  Nodes nodes(two_nodes());
  Node& node = nodes.of(2);
  EXPECT_FALSE(nodes.any_heard());
  EXPECT_EQ(node.on_heartbeat(heartbeat_of(2, 0x7F), stage_at(0)),
            canopen::NmtState::pre_operational);
  EXPECT_TRUE(nodes.any_heard());
  EXPECT_FALSE(nodes.any_running());
  EXPECT_EQ(node.on_heartbeat(heartbeat_of(2, 0x05), stage_at(100)),
            canopen::NmtState::operational);
  EXPECT_TRUE(nodes.any_running());
  EXPECT_EQ(node.heartbeat_stamp, stage_at(100));
  EXPECT_FALSE(nodes.all_operational());
  EXPECT_EQ(node.on_heartbeat(heartbeat_of(2, 0x00), stage_at(200)), canopen::NmtState::boot_up);
  EXPECT_FALSE(nodes.any_heard());
}

TEST(Node, NoOtherFrameIsAHeartbeat) {
  Nodes nodes(two_nodes());
  Node& node = nodes.of(1);
  EXPECT_EQ(node.on_heartbeat(heartbeat_of(1, 0x06), stage_at(0)), std::nullopt);
  EXPECT_EQ(node.on_heartbeat(CanFrame::make(canopen::kHeartbeat + 1, {0x05, 0x00}), stage_at(0)),
            std::nullopt);
  EXPECT_EQ(node.state, std::nullopt);
  EXPECT_FALSE(node.heard);
}

TEST(Nodes, OnlyTheOnesThatWereCommandedRunAtANewStart) {
  Nodes nodes(two_nodes());
  nodes.of(1).on_heartbeat(heartbeat_of(1, 0x05), stage_at(0));
  nodes.of(2).on_heartbeat(heartbeat_of(2, 0x00), stage_at(0));
  nodes.begin_inquiry(false);
  EXPECT_TRUE(nodes.of(1).heard);
  EXPECT_FALSE(nodes.of(2).heard) << "it has just booted";
  EXPECT_FALSE(nodes.any_running());
  nodes.begin_inquiry(true);
  EXPECT_TRUE(nodes.of(1).running);
}

}  // namespace
}  // namespace tether::cia402
