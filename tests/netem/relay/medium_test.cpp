#include <gtest/gtest.h>

#include <tether/counters_t.hpp>

#include "netem/relay/netem_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::VirtualWorld;

struct RelayedPoses {
  std::vector<Seen<pose_t>> poses;
  counters_t counters;
};

double at_the_origin(int /*i*/) { return 0.0; }

/// 60 s of poses at 10 Hz.
RelayedPoses relayed_poses(const std::string& toml, double (*x_m)(int) = at_the_origin) {
  const Scenario scenario = parse_scenario(toml, "test.toml");
  VirtualWorld world;
  RelayedPoses out;
  std::vector<Seen<counters_t>> counters;
  world.collect("CTRL/POSE", out.poses);
  world.collect("NET/COUNTERS", counters);
  NetemNode node(scenario, world.loop, world.bus, world.bus);
  for (int i = 0; i < 600; ++i) {
    world.publish_at(at_ms(100 * i), "AGV/POSE", test::pose(at_ms(100 * i), i, x_m(i)));
  }
  world.loop.run_until(at_s(70));
  node.finish();
  world.loop.run_until(at_s(70));
  out.counters = counters.back().message;
  return out;
}

Duration longest_delay(const RelayedPoses& relayed) {
  Duration longest{};
  for (const auto& p : relayed.poses) {
    longest = std::max(longest, p.when - from_utime(p.message.utime));
  }
  return longest;
}

// Up to a slot, data and acknowledgement of 150 bytes: below 0.2 ms.
TEST(RelayOnAMedium, DelaysAPoseByItsFrameIfNoOtherStationSends) {
  const RelayedPoses alone = relayed_poses("medium.model = \"edca\"");
  EXPECT_EQ(alone.poses.size(), 600U);
  EXPECT_GT(longest_delay(alone), Duration{0});
  EXPECT_LT(longest_delay(alone), std::chrono::microseconds{200});
}

// Poses are sent for 60 s, and the run has 70.
TEST(RelayOnAMedium, CountsWhatOthersSendToTheEndOfTheRun) {
  const RelayedPoses among = relayed_poses(
      "medium.model = \"dcf\"\n[[medium.background]]\nkind = \"saturated\"\nstations = 1\n");
  for (std::size_t i = 0; i < among.counters.name.size(); ++i) {
    if (among.counters.name[i] != "medium.transmissions") continue;
    // A frame of 1400 bytes with acknowledgement and backoff: 0.36 ms.
    EXPECT_GT(among.counters.value[i], 69'000 / 0.4);
    return;
  }
  FAIL() << "no transmissions are counted";
}

TEST(RelayOnAMedium, LetsPosesWaitForGrants) {
  const RelayedPoses cell = relayed_poses("medium.model = \"scheduled\"");
  EXPECT_EQ(cell.poses.size(), 600U);
  // A request period, the offset, a slot to wait for and one to send.
  EXPECT_GT(longest_delay(cell), std::chrono::milliseconds{2});
  EXPECT_LE(longest_delay(cell), std::chrono::microseconds{23'500});
}

TEST(RelayOnAMedium, OffersLinksWhatTheMediumDelivers) {
  const RelayedPoses crowded = relayed_poses(
      "medium.model = \"dcf\"\nmedium.lifetime_ms = 20.0\nmedium.rate_Mbps = "
      "6.0\nchannel.uplink.prr = "
      "0.5\n[[medium.background]]\nkind = \"saturated\"\nstations = 30\n");
  const auto count = [&crowded](const char* name) { return test::counter(crowded.counters, name); };
  EXPECT_EQ(count("medium.sent"), 600);
  EXPECT_EQ(count("medium.sent"), count("medium.delivered") + count("medium.lost"));
  EXPECT_GT(count("medium.lost"), 100);
  EXPECT_EQ(count("medium.lost"), count("medium.lost.attempts") + count("medium.lost.late") +
                                      count("medium.lost.no_room"));
  EXPECT_EQ(count("uplink.offered"), count("medium.delivered"));
  EXPECT_EQ(static_cast<std::int64_t>(crowded.poses.size()), count("uplink.delivered"));
  EXPECT_GT(count("medium.collisions"), 0);
}

// Poses are 1 m further with each, and 20 dBm do not reach as far as 599 m.
TEST(RelayOnAMedium, LosesWhatIsSentFarFromAccessPoints) {
  const RelayedPoses left = relayed_poses(
      "medium.model = \"dcf\"\nmedium.radio.model = \"hall\"\n"
      "medium.radio.access_points = [[0, 0]]\n",
      [](int i) { return static_cast<double>(i); });
  const auto lost = test::counter(left.counters, "medium.lost");
  EXPECT_GT(lost, 100);
  EXPECT_LT(lost, 550);
  EXPECT_EQ(static_cast<std::int64_t>(left.poses.size()), 600 - lost);
  EXPECT_LT(left.poses.back().message.seq, 500);
}

TEST(RelayOnAMedium, LetsPosesWaitWhileTheVehicleChangesItsAccessPoint) {
  const RelayedPoses gone_over = relayed_poses(
      "medium.model = \"dcf\"\nmedium.lifetime_ms = 2000.0\nmedium.radio.model = "
      "\"hall\"\nmedium.radio.access_points = [[0, 0], [599, 0]]\n"
      "medium.radio.power_dBm = 50.0\nmedium.radio.roaming_break_ms = 1000.0\n"
      "medium.radio.roaming_hysteresis_db = 20.0\n",
      [](int i) { return static_cast<double>(i); });
  EXPECT_EQ(gone_over.poses.size(), 600U);
  EXPECT_GE(test::counter(gone_over.counters, "medium.roaming.changes"), 1);
  EXPECT_GT(longest_delay(gone_over), std::chrono::milliseconds{1000});
  EXPECT_LT(longest_delay(gone_over), std::chrono::milliseconds{1010});
}

TEST(RelayOnAMedium, DoesTheSameTwice) {
  const std::string toml =
      "medium.model = \"edca\"\n[[medium.background]]\nkind = \"poisson\"\nstations = "
      "20\nrate_hz = 100\n";
  const RelayedPoses once = relayed_poses(toml), twice = relayed_poses(toml);
  ASSERT_EQ(once.poses.size(), twice.poses.size());
  for (std::size_t i = 0; i < once.poses.size(); ++i) {
    EXPECT_EQ(once.poses[i].when, twice.poses[i].when);
  }
}

}  // namespace
}  // namespace tether
