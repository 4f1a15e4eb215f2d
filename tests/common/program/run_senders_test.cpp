#include <gmock/gmock.h>

#include <optional>
#include <string>
#include <vector>

#include "common/program/presence.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;

constexpr std::uint64_t kNetem = 0x0100007F'0000'1000, kStray = 0x0100007F'0000'2000;

/// A loop in real time, whose time the test sets.
class LiveLoop final : public EventLoop {
 public:
  Instant now() const override { return time; }
  std::int64_t run_id() const override { return run; }
  double rate() const override { return 1.0; }
  void at(Instant, Priority, Task) override {}
  void every(Instant, Duration, Priority, Task) override {}
  void add_fd(int, Task) override {}
  void remove_fd(int) override {}
  void stop() override {}
  std::uint64_t slips() const override { return 0; }

  Instant time = kStart;
  std::int64_t run = 7;
};

struct RunSendersTest : ::testing::Test {
  void expect(const std::vector<std::string>& nodes) { expected = nodes, make(); }
  void make() {
    senders.emplace(RunSenders::Config{{{"CTRL/POSE", "netem"},
                                        {"AGV/CMD_VEL", "netem"},
                                        {"CTRL/CMD_VEL", "controller"},
                                        {"CAN/STATE", "can"},
                                        {"SIM/CLOCK", "sim"}},
                                       "AGV",
                                       expected},
                    loop);
  }
  bool hear(const std::string& program, std::uint64_t sender, const std::string& vehicle = "AGV",
            std::int64_t run = 7) {
    presence_t p{};
    p.program = program, p.vehicle = vehicle, p.run = run;
    return senders->heard(p, sender);
  }
  bool takes(const std::string& channel, std::uint64_t sender) const {
    return senders->takes({.channel = channel, .bytes = {}, .sender = sender});
  }

  LiveLoop loop;
  std::vector<std::string> expected;
  std::optional<RunSenders> senders;
};

TEST_F(RunSendersTest, AnExpectedNodesChannelsAreTakenFromItAloneFromTheFirstMessageOn) {
  expect({"netem"});
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
  EXPECT_FALSE(takes("CTRL/POSE", kNetem));
  EXPECT_TRUE(hear("tether-netem", kNetem));
  EXPECT_FALSE(hear("tether-netem", kNetem)) << "known by now";
  EXPECT_TRUE(takes("CTRL/POSE", kNetem));
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
  loop.time += 1h;  // its presences may be lost
  EXPECT_TRUE(takes("CTRL/POSE", kNetem));
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
}

TEST_F(RunSendersTest, AProgramIsNoOwnerOfAnothersChannels) {
  expect({"netem", "controller"});
  hear("tether-controller", kStray);
  EXPECT_FALSE(takes("AGV/CMD_VEL", kStray));
  EXPECT_TRUE(takes("CTRL/CMD_VEL", kStray));
}

TEST_F(RunSendersTest, BothProgramsOfTheDrivetrainOwnItsChannelsAndNoLikeNamedOneDoes) {
  expect({"can"});
  hear("tether-can-bridge", 1), hear("tether-can-drive", 2), hear("tether-canvas", 3);
  EXPECT_TRUE(takes("CAN/STATE", 1));
  EXPECT_TRUE(takes("CAN/STATE", 2));
  EXPECT_FALSE(takes("CAN/STATE", 3));
}

TEST_F(RunSendersTest, WithoutAnOwnerAnotherProgramMayHaveItsPlaceUntilTheOwnerIsHeard) {
  make();
  EXPECT_TRUE(takes("CTRL/POSE", kStray));
  hear("tether-netem", kNetem);
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
  EXPECT_EQ(senders->owner_heard({.channel = "CTRL/POSE", .bytes = {}, .sender = kStray}),
            "tether-netem");
  loop.time += RunSenders::kForgotten - 1ns;
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
  loop.time += 1ns;
  EXPECT_TRUE(takes("CTRL/POSE", kStray)) << "the owner has ended, and a log is played";
}

TEST_F(RunSendersTest, ARestartedNodeIsTakenFromItsNewPortOnceItHasSaidSo) {
  expect({"netem"});
  hear("tether-netem", kNetem);
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
  EXPECT_TRUE(hear("tether-netem", kStray));
  EXPECT_TRUE(takes("CTRL/POSE", kStray));
}

TEST_F(RunSendersTest, PresencesOfOtherRunsAndVehiclesNameNoOwner) {
  expect({"netem"});
  hear("tether-netem", kNetem, "AGV", 6);
  EXPECT_FALSE(takes("CTRL/POSE", kNetem));
  hear("tether-netem", kStray, "AGV2");
  EXPECT_FALSE(takes("CTRL/POSE", kStray));
}

TEST_F(RunSendersTest, TheClockMayBeOfAnotherRunSoThatANewOneIsNoticed) {
  make();
  hear("tether-sim", 1);
  EXPECT_FALSE(takes("SIM/CLOCK", 2));
  hear("tether-sim", 2, "AGV", 8);
  EXPECT_TRUE(takes("SIM/CLOCK", 2));
}

TEST_F(RunSendersTest, FreeChannelsAndSendersThatTheNetworkDoesNotTellAreTaken) {
  expect({"netem"});
  EXPECT_TRUE(takes("MY/CHANNEL", kStray));
  EXPECT_TRUE(takes("CTRL/POSE", 0));
}

TEST_F(RunSendersTest, AFloodOfPresencesDisplacesNoLiveSender) {
  expect({"netem"});
  hear("tether-netem", kNetem);
  for (std::uint64_t other = 1; other < 1000; ++other) hear("tether-sim", other);
  EXPECT_TRUE(takes("CTRL/POSE", kNetem));
  EXPECT_FALSE(hear("tether-controller", 5000)) << "no room";
  loop.time += 2s;
  hear("tether-netem", kNetem);
  EXPECT_TRUE(hear("tether-controller", 5000));
  EXPECT_TRUE(takes("CTRL/POSE", kNetem));
}

}  // namespace
}  // namespace tether
