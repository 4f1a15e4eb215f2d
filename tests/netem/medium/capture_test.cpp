#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "netem/medium/shared_medium.hpp"
#include "netem/medium/wifi_airtime.hpp"
#include "tests/netem/medium/two_stations.hpp"

namespace tether {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;

// Two saturated stations, of which the first is always received: it succeeds with every
// attempt, and both have of the medium what their Markov chain says. 2e5 transmissions; a share has
// a standard error below that of as many independent draws, 0.0011; four of them.
TEST(Capture, LeavesTheStrongerOfTwoStationsUnaffectedByCollisions) {
  const AccessParameters access{15, 31, 2, 4};
  Contention medium({.slot = microseconds{9}, .sifs = microseconds{16}}, 1, [](const FrameEnd&) {});
  medium.set_capture([](std::span<const Frame> frames, std::size_t which) {
    return frames[which].station == 0 ? 0.0 : 1.0;
  });
  for (const int i : {0, 1}) {
    Frame frame = unicast_frame({}, 1534, true);
    frame.station = i;
    medium.saturate(kStart, medium.add(i, access, {}, fmt::format("station {}", i)), frame);
  }
  constexpr double kTransmissions = 200'000;
  const Contention::Counters& c = medium.counters();
  while (static_cast<double>(c.transmissions) < kTransmissions) {
    medium.advance(medium.next_event());
  }
  const TwoStations exact =
      TwoStationsChain(access, access, ContentionRules::Countdown::slot_boundaries, true)
          .solve(300);
  const auto share = [&](std::int64_t n) { return static_cast<double>(n) / kTransmissions; };
  EXPECT_EQ(c.captured, c.collisions);
  EXPECT_EQ(c.collided, 2 * c.collisions);
  EXPECT_EQ(c.attempts, medium.delivered(0) + medium.delivered(1) + c.collisions);
  EXPECT_NEAR(share(medium.delivered(0)), exact.first, 0.0045);
  EXPECT_NEAR(share(medium.delivered(1)), exact.second, 0.0045);
  EXPECT_NEAR(share(c.collisions), exact.collisions, 0.0045);
  EXPECT_GT(medium.delivered(0), medium.delivered(1) + 10'000);
}

/// A vehicle sends once a packet, with 60 dB, among five stations that always send, with 20 dB.
MediumSettings crowd() {
  MediumSettings settings{.model = MediumSettings::Model::dcf, .attempts = 1};
  settings.radio.model = RadioSettings::Model::fixed;
  settings.radio.snr_db = 60.0;
  settings.rate_Mbps = 12.0;
  settings.background = {
      {.kind = MediumSettings::Background::Kind::saturated, .stations = 5, .snr_db = 20.0}};
  return settings;
}

/// Lost packets of 2000 of a vehicle.
int lost(const MediumSettings& settings, Way way) {
  int lost = 0;
  const auto medium = SharedMedium::make(
      settings, 1, [&lost](const PacketFateOnAir& fate) { lost += fate.delivered ? 0 : 1; });
  medium->add_vehicle("AGV");
  for (int i = 0; i < 2000; ++i) {
    medium->send(kStart + i * milliseconds{30}, 0, way, static_cast<std::uint64_t>(i), 80);
  }
  medium->advance(kStart + milliseconds{61'000});
  return lost;
}

TEST(Capture, NeedsASignalThatIsStrongEnough) {
  MediumSettings settings = crowd();
  const int without = lost(settings, Way::up);
  EXPECT_GT(without, 300);
  settings.radio.capture_sinr_db = 10.0;
  EXPECT_EQ(lost(settings, Way::up), 0);
  settings.radio.snr_db = 29.0;  // 9 dB above one of the others
  EXPECT_EQ(lost(settings, Way::up), without);
  settings.radio.snr_db = 35.0;  // more than 10 dB above one, but not above five
  EXPECT_LT(lost(settings, Way::up), without);
}

TEST(Capture, DoesNotHelpWhatAnAccessPointSends) {
  MediumSettings settings = crowd();
  const int without = lost(settings, Way::down);
  EXPECT_GT(without, 300);
  settings.radio.capture_sinr_db = 10.0;
  EXPECT_EQ(lost(settings, Way::down), without);
}

// Both find the medium idle and go at the same time.
TEST(Capture, ReceivesTheVehicleThatIsNearItsAccessPoint) {
  for (const bool captures : {false, true}) {
    MediumSettings settings{.model = MediumSettings::Model::dcf, .attempts = 1};
    settings.radio.model = RadioSettings::Model::hall;
    settings.radio.access_points = {{0.0, 0.0}};
    if (captures) settings.radio.capture_sinr_db = 6.0;
    settings.rate_Mbps = 6.0;
    std::map<std::uint64_t, bool> delivered;
    const auto medium = SharedMedium::make(settings, 1, [&delivered](const PacketFateOnAir& fate) {
      delivered[fate.id] = fate.delivered;
    });
    const std::size_t near = medium->add_vehicle("near"), far = medium->add_vehicle("far");
    medium->on_position(near, 2.0, 0.0, kStart);
    medium->on_position(far, 100.0, 0.0, kStart);
    medium->send(kStart + milliseconds{1}, near, Way::up, 1, 80);
    medium->send(kStart + milliseconds{1}, far, Way::up, 2, 80);
    medium->advance(kStart + milliseconds{100});
    EXPECT_EQ(delivered.at(1), captures);
    EXPECT_FALSE(delivered.at(2));
  }
}

}  // namespace
}  // namespace tether
