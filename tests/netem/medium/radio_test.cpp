#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "netem/medium/ofdm_errors.hpp"
#include "netem/medium/shared_medium.hpp"
#include "netem/medium/wifi_stations.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using std::chrono::microseconds;
using std::chrono::milliseconds;
using testing::HasSubstr;
using Model = RadioSettings::Model;

/// One station that always has a frame.
struct Saturated {
  explicit Saturated(MediumSettings settings)
      : stations((settings.background = {{.kind = MediumSettings::Background::Kind::saturated,
                                          .bytes = 1472}},
                  settings),
                 1, [](const FrameEnd&) {}) {
    while (stations.counters().attempts < 100'000) stations.advance(stations.next_event());
  }
  WifiStations stations;
};

/// A DCF whose stations have this SNR.
MediumSettings fixed(double snr_db) {
  MediumSettings settings{.model = MediumSettings::Model::dcf};
  settings.radio.model = Model::fixed;
  settings.radio.snr_db = snr_db;
  return settings;
}

// Attempt k of up to L, which begins with probability p^k, takes AIFS, half of its window in the
// mean, and the exchange. 1e5 attempts: the standard error of p is 0.0015, that of the
// rate below 0.3 % for p and as much for the windows, which depend on it; four of them.
TEST(Radio, HasTheThroughputAndTheLossesOfOneStationInClosedForm) {
  const MediumSettings settings = fixed(22.2);
  const int bytes = 1500 + kWifiOverheadBytes;
  const double p = frame_error_ratio(54, frame_bits(bytes), 22.2);
  ASSERT_GT(p, 0.3);
  ASSERT_LT(p, 0.6);
  const Frame frame = unicast_frame(phy_of(settings), bytes, true);
  double attempts = 0.0, time_s = 0.0;
  for (int k = 0; k < settings.attempts; ++k) {
    const int window = std::min((16 << k) - 1, 1023);
    const double reached = std::pow(p, k);
    attempts += reached;
    time_s += reached *
              to_seconds(microseconds{16 + 2 * 9} + microseconds{9} * window / 2 + frame.exchange);
  }
  const Saturated found(settings);
  const Contention::Counters& c = found.stations.counters();
  const auto n = static_cast<double>(c.attempts);
  const double error = std::sqrt(p * (1 - p) / n);
  EXPECT_NEAR(static_cast<double>(c.corrupted) / n, p, 4 * error);
  const double lost = std::pow(p, static_cast<double>(settings.attempts));
  const double frames = n / attempts;
  EXPECT_NEAR(static_cast<double>(c.dropped) / frames, lost, 4 * std::sqrt(lost / frames));
  const double expected = (1 - lost) / time_s;
  const double rate = static_cast<double>(c.delivered) / to_seconds(found.stations.next_event());
  EXPECT_NEAR(rate, expected, 0.017 * expected);
}

/// Packets of one vehicle, each sent when the one before has ended; their share that is lost.
double lost_share(const MediumSettings& settings, Way way, int packets, int bytes) {
  int lost = 0;
  const auto medium = SharedMedium::make(
      settings, 3, [&lost](const PacketFateOnAir& fate) { lost += fate.delivered ? 0 : 1; });
  const std::size_t agv = medium->add_vehicle("AGV");
  for (int i = 0; i < packets; ++i) {
    const Instant now = kStart + i * milliseconds{20};
    medium->advance(now);
    medium->send(now, agv, way, static_cast<std::uint64_t>(i), bytes);
  }
  medium->advance(kStart + (packets + 10) * milliseconds{20});
  return static_cast<double>(lost) / packets;
}

TEST(Radio, LosesAPacketIfNoiseDestroysAllAttempts) {
  MediumSettings settings = fixed(21.3);
  settings.attempts = 3;
  const double p =
      frame_error_ratio(54, frame_bits(fragment_bytes(200).front() + kWifiOverheadBytes), 21.3);
  const double expected = std::pow(p, 3);
  ASSERT_GT(expected, 0.02);
  constexpr int kPackets = 10'000;
  for (const Way way : {Way::up, Way::down}) {
    EXPECT_NEAR(lost_share(settings, way, kPackets, 200), expected,
                4 * std::sqrt(expected * (1 - expected) / kPackets));
  }
}

/// Which of 1000 packets of a vehicle, both ways in turn, are delivered, while others send and get
/// as many in between.
std::vector<bool> luck(std::size_t others) {
  MediumSettings settings = fixed(21.3);
  settings.attempts = 1;
  std::vector<bool> delivered(1000);
  const auto medium = SharedMedium::make(settings, 3, [&](const PacketFateOnAir& fate) {
    if (fate.id < delivered.size()) delivered[fate.id] = fate.delivered;
  });
  std::uint64_t other_id = delivered.size();
  for (std::size_t i = 0; i <= others; ++i) medium->add_vehicle(fmt::format("AGV{}", i));
  for (std::size_t i = 0; i < delivered.size(); ++i) {
    const Instant now = kStart + i * milliseconds{20};
    medium->send(now, 0, i % 2 == 0 ? Way::up : Way::down, i, 200);
    for (std::size_t k = 1; k <= others; ++k) {
      const Way way = i % 2 == 0 ? Way::down : Way::up;
      medium->send(now + k * milliseconds{3}, k, way, other_id++, 200);
    }
  }
  medium->advance(kStart + milliseconds{30'000});
  return delivered;
}

TEST(Radio, DrawsTheSameForAVehicleWhateverOthersSend) {
  const std::vector<bool> alone = luck(0);
  EXPECT_GT(std::count(alone.begin(), alone.end(), false), 100);
  EXPECT_EQ(luck(5), alone);
}

TEST(Radio, TakesALowerRateWhereTheHighestLosesTooMuch) {
  MediumSettings settings = fixed(12.0);
  EXPECT_EQ(lost_share(settings, Way::up, 100, 80), 1.0);
  settings.radio.adapt_rate = true;
  EXPECT_EQ(lost_share(settings, Way::up, 1000, 80), 0.0);

  const double slow = Saturated(settings).stations.counters().busy / microseconds{100'000};
  settings.radio.snr_db = 40.0;
  const double fast = Saturated(settings).stations.counters().busy / microseconds{100'000};
  const int bytes = 1500 + kWifiOverheadBytes;
  EXPECT_EQ(best_rate_mbps(54, bytes, 12.0, 0.1), 18.0);
  const auto air_us = [](double rate_Mbps, double control_Mbps) {
    return (ofdm_airtime(bytes, rate_Mbps) + ofdm_airtime(kAckBytes, control_Mbps)) /
           microseconds{1};
  };
  EXPECT_NEAR(slow, static_cast<double>(air_us(18, 12) + 16), 1.0);
  EXPECT_NEAR(fast, static_cast<double>(air_us(54, 24) + 16), 1.0);
}

/// A hall with one weak access point at (0, 0).
MediumSettings hall() {
  MediumSettings settings{.model = MediumSettings::Model::edca};
  settings.radio.model = Model::hall;
  settings.radio.access_points = {{0.0, 0.0}};
  settings.radio.power_dBm = 5.0;
  return settings;
}

TEST(Radio, IsWhatTheHallSaysOfWhereAVehicleIs) {
  RadioLinks links(hall().radio, 1);
  const std::size_t agv = links.add(), other = links.add();
  const auto noise_dBm = -174.0 + 10.0 * std::log10(20e6) + 7.0;
  RandomEngine random = random_stream(1, "medium/access point/0,0/radio");
  const IndoorFactoryMap map(hall().radio.hall(), 0.0, 0.0, random);
  for (const double x_m : {5.0, 20.0, 80.0}) {
    links.move(agv, x_m, 7.0);
    EXPECT_DOUBLE_EQ(links.snr_db(agv), 5.0 - map.path_loss_db(x_m, 7.0) - noise_dBm);
    links.move(other, x_m, 7.0);
    EXPECT_EQ(links.snr_db(other), links.snr_db(agv));
  }
}

TEST(Radio, TalksToTheAccessPointThatIsHeardBest) {
  RadioSettings settings = hall().radio;
  settings.access_points = {{0.0, 0.0}, {200.0, 0.0}};
  RadioLinks links(settings, 1);
  const std::size_t agv = links.add();
  EXPECT_EQ(links.access_point(agv), 0U);
  links.move(agv, 195.0, 0.0);
  links.choose(agv);
  EXPECT_EQ(links.access_point(agv), 1U);
  EXPECT_EQ(links.snr_db(agv), links.snr_db(agv, 1));
  EXPECT_GT(links.snr_db(agv, 1), links.snr_db(agv, 0));
}

TEST(Radio, LosesWhatAVehicleSendsFromAfar) {
  std::map<std::uint64_t, bool> delivered;
  const auto medium = SharedMedium::make(hall(), 1, [&delivered](const PacketFateOnAir& fate) {
    delivered[fate.id] = fate.delivered;
  });
  ASSERT_TRUE(medium->wants_position());
  const std::size_t near = medium->add_vehicle("near"), far = medium->add_vehicle("far");
  medium->on_position(near, 3.0, 0.0, kStart);
  medium->on_position(far, 3000.0, 0.0, kStart);
  medium->send(kStart, near, Way::up, 1, 80);
  medium->send(kStart, near, Way::down, 2, 80);
  medium->send(kStart, far, Way::up, 3, 80);
  medium->send(kStart, far, Way::down, 4, 80);
  medium->advance(kStart + milliseconds{1000});
  EXPECT_EQ(delivered,
            (std::map<std::uint64_t, bool>{{1, true}, {2, true}, {3, false}, {4, false}}));
}

class RadioSection : public testing::Test {
 protected:
  static std::string refusal(const std::string& toml) {
    return refusal_of([&toml] { parse_scenario("medium.model = \"dcf\"\n" + toml, "some.toml"); });
  }
  static constexpr const char* kHall =
      "[medium.radio]\nmodel = \"hall\"\naccess_points = [[0, 0]]\n";
};

TEST_F(RadioSection, WritesWhatItReads) {
  const std::string toml = std::string("medium.model = \"edca\"\n") + kHall +
                           "clutter = \"dense_low\"\nstation_height_m = 3\n[[medium.background]]\n"
                           "snr_db = 12\n";
  const Scenario once = parse_scenario(toml, "some.toml");
  EXPECT_EQ(to_toml(parse_scenario(to_toml(once), "some.toml")), to_toml(once));
  const auto& medium = once.get<MediumSettings>();
  EXPECT_EQ(medium.radio.hall().station_height_m, 3.0);
  EXPECT_EQ(medium.radio.hall().clutter_density, 0.6);
  EXPECT_EQ(medium.background[0].snr_db, 12.0);
}

TEST_F(RadioSection, SaysNothingOfARadioThatIsNotThere) {
  EXPECT_EQ(to_toml(parse_scenario("medium.model = \"dcf\"", "some.toml")).find("radio"),
            std::string::npos);
}

TEST_F(RadioSection, RefusesWhatItDoesNotKnow) {
  EXPECT_THAT(refusal("medium.radio.model = \"moon\""),
              HasSubstr("must be \"none\" or \"fixed\" or \"hall\""));
  EXPECT_THAT(refusal("medium.radio.model = \"hall\"\nmedium.radio.clutter = \"empty\""),
              HasSubstr("\"sparse_low\" or \"dense_low\" or \"sparse_high\" or \"dense_high\""));
  EXPECT_THAT(refusal("medium.radio.gain_db = 3"), HasSubstr("medium.radio.gain_db"));
}

TEST_F(RadioSection, RefusesWhatHasNoEffect) {
  EXPECT_THAT(refusal("medium.radio.snr_db = 3"), HasSubstr("medium.radio.model is \"none\""));
  EXPECT_THAT(refusal(std::string(kHall) + "snr_db = 3"),
              HasSubstr("medium.radio.model is \"hall\""));
  EXPECT_THAT(refusal("medium.radio.model = \"fixed\"\nmedium.radio.power_dBm = 3"),
              HasSubstr("medium.radio.model is \"fixed\""));
  EXPECT_THAT(refusal("medium.radio.model = \"fixed\"\nmedium.radio.highest_error_ratio = 0.5"),
              HasSubstr("medium.radio.adapt_rate is false"));
  EXPECT_THAT(refusal("[[medium.background]]\nsnr_db = 3"),
              HasSubstr("snr_db has no effect: medium.radio.model is \"none\""));
  EXPECT_THAT(refusal_of([] {
                parse_scenario("medium.model = \"scheduled\"\nmedium.radio.model = \"fixed\"",
                               "some.toml");
              }),
              HasSubstr("medium.radio.model has no effect: medium.model is \"scheduled\""));
}

TEST_F(RadioSection, RefusesWhatDoesNotGoTogether) {
  EXPECT_THAT(refusal("medium.radio.model = \"hall\""),
              HasSubstr("some.toml: medium.radio.model = \"hall\" needs "
                        "medium.radio.access_points"));
  EXPECT_THAT(refusal("medium.radio.model = \"hall\"\nmedium.radio.access_points = [[1, 2, 3]]"),
              HasSubstr("medium.radio.access_points: each must be [x_m, y_m]"));
  EXPECT_THAT(refusal("medium.rate_Mbps = 50\nmedium.radio.model = \"fixed\""),
              HasSubstr("medium.rate_Mbps = 50 must be one of 6, 9, 12, 18, 24, 36, 48, 54"));
  EXPECT_THAT(refusal("medium.he = true\nmedium.radio.model = \"fixed\""),
              HasSubstr("medium.he = true does not go with medium.radio.model"));
  EXPECT_THAT(refusal(std::string(kHall) + "station_height_m = 1.9"),
              HasSubstr("heights must rise from vehicle_height_m = 1.5 over clutter_height_m = 2 "
                        "to station_height_m = 1.9"));
}

}  // namespace
}  // namespace tether
