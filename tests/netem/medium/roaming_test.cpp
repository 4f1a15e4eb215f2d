#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>

#include "netem/medium/shared_medium.hpp"
#include "netem/medium/wifi_stations.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

constexpr double kFar_m = 300.0;

/// Two access points that are far from each other, at 6 Mbit/s.
MediumSettings two_access_points(bool waits, double break_ms = 200.0) {
  MediumSettings settings{.model = MediumSettings::Model::dcf, .rate_Mbps = 6.0};
  settings.radio.model = RadioSettings::Model::hall;
  settings.radio.access_points = {{0.0, 0.0}, {kFar_m, 0.0}};
  settings.radio.roaming_break_ms = break_ms;
  settings.radio.roaming_waits = waits;
  return settings;
}

struct RoamingRig {
  explicit RoamingRig(const MediumSettings& settings)
      : medium(SharedMedium::make(settings, 1, [this](const PacketFateOnAir& fate) {
          ++ends;
          fates[fate.id] = fate;
        })) {}
  std::int64_t counter(const std::string& name) const {
    CounterList counters;
    medium->list(counters);
    for (const auto& [other, value] : counters) {
      if (other == name) return value;
    }
    return -1;
  }
  std::map<std::uint64_t, PacketFateOnAir> fates;
  std::size_t ends = 0;
  std::unique_ptr<SharedMedium> medium;
};

Instant at_ms(int ms) { return kStart + milliseconds{ms}; }

/// A vehicle goes to the other access point at 1 s; packets both ways every 10 ms, up with even
/// numbers: packet n at 5 n ms.
RoamingRig gone_over(const MediumSettings& settings) {
  RoamingRig rig(settings);
  rig.medium->add_vehicle("AGV");
  rig.medium->on_position(0, 1.0, 0.0, kStart);
  for (int n = 0; n < 400; ++n) {
    if (n == 200) rig.medium->on_position(0, kFar_m - 1.0, 0.0, at_ms(1000));
    rig.medium->send(at_ms(5 * n), 0, n % 2 == 0 ? Way::up : Way::down,
                     static_cast<std::uint64_t>(n), 80);
  }
  rig.medium->advance(at_ms(10'000));
  return rig;
}

TEST(Roaming, LetsPacketsOfBothWaysWaitForTheEndOfTheBreak) {
  const RoamingRig rig = gone_over(two_access_points(true));
  for (const auto& [n, fate] : rig.fates) {
    EXPECT_TRUE(fate.delivered) << n;
    const bool in_break = n >= 200 && n < 240;
    const Instant sent = at_ms(5 * static_cast<int>(n));
    EXPECT_GT(fate.at, in_break ? at_ms(1200) : sent);
    EXPECT_LT(fate.at, in_break ? at_ms(1250) : sent + milliseconds{n < 250 ? 50 : 2});
  }
  EXPECT_EQ(rig.fates.size(), 400U);
  EXPECT_EQ(rig.counter("medium.roaming.changes"), 1);
  EXPECT_EQ(rig.counter("medium.roaming.held"), 40);
  EXPECT_EQ(rig.counter("medium.roaming.lost"), 0);
}

TEST(Roaming, DelaysNothingIfThereIsNoBreak) {
  const RoamingRig rig = gone_over(two_access_points(false, 0.0));
  for (const auto& [n, fate] : rig.fates) {
    EXPECT_TRUE(fate.delivered) << n;
    EXPECT_LT(fate.at, at_ms(5 * static_cast<int>(n) + 2));
  }
}

// In the middle of the break the vehicle comes back: it goes on to the other access point, and then
// needs another break.
TEST(Roaming, EndsOneBreakBeforeTheNext) {
  RoamingRig rig(two_access_points(true));
  rig.medium->add_vehicle("AGV");
  rig.medium->on_position(0, 1.0, 0.0, kStart);
  rig.medium->on_position(0, kFar_m, 0.0, at_ms(1000));
  rig.medium->on_position(0, 1.0, 0.0, at_ms(1100));
  EXPECT_EQ(rig.counter("medium.roaming.changes"), 1);
  rig.medium->on_position(0, 1.0, 0.0, at_ms(1300));
  EXPECT_EQ(rig.counter("medium.roaming.changes"), 2);
  rig.medium->send(at_ms(1400), 0, Way::up, 1, 80);
  rig.medium->advance(at_ms(2000));
  EXPECT_TRUE(rig.fates.at(1).delivered);
  EXPECT_GT(rig.fates.at(1).at, at_ms(1500));
}

TEST(Roaming, LosesPacketsOfTheBreakIfTheyDoNotWait) {
  const RoamingRig rig = gone_over(two_access_points(false));
  for (const auto& [n, fate] : rig.fates) EXPECT_EQ(fate.delivered, n < 200 || n >= 240) << n;
  EXPECT_EQ(rig.counter("medium.roaming.lost"), 40);
}

TEST(Roaming, LetsPacketsWaitForNoLongerThanTheirLifetime) {
  MediumSettings settings = two_access_points(true);
  settings.lifetime_ms = 99.0;
  const RoamingRig rig = gone_over(settings);
  for (const auto& [n, fate] : rig.fates) EXPECT_EQ(fate.delivered, n < 200 || n > 220) << n;
  EXPECT_EQ(rig.counter("medium.roaming.lost"), 21);
}

TEST(Roaming, LetsNoMorePacketsWaitThanAQueueHolds) {
  MediumSettings settings = two_access_points(true);
  settings.queue = 15;
  const RoamingRig rig = gone_over(settings);
  EXPECT_EQ(rig.counter("medium.roaming.held"), 2 * 15);
  EXPECT_EQ(rig.counter("medium.roaming.lost"), 2 * 5);
}

// 30 packets of 1400 bytes take 60 ms: what is in queues goes along, what others are sent stays.
TEST(Roaming, TakesWhatIsQueuedAlong) {
  RoamingRig rig(two_access_points(true));
  for (const char* name : {"roams", "stays"}) rig.medium->add_vehicle(name);
  rig.medium->on_position(0, 1.0, 0.0, kStart);
  rig.medium->on_position(1, 1.0, 0.0, kStart);
  for (std::uint64_t n = 0; n < 30; ++n) {
    rig.medium->send(at_ms(1), n % 2, n % 3 == 0 ? Way::up : Way::down, n, 1400);
  }
  rig.medium->on_position(0, kFar_m, 0.0, at_ms(10));
  rig.medium->advance(at_ms(1000));
  int before = 0;
  for (const auto& [n, fate] : rig.fates) {
    EXPECT_TRUE(fate.delivered);
    const bool roams = n % 2 == 0, was_before = fate.at < at_ms(13);
    EXPECT_TRUE(roams ? was_before || fate.at > at_ms(210) : fate.at < at_ms(100)) << n;
    before += roams && was_before ? 1 : 0;
  }
  EXPECT_EQ(rig.counter("medium.roaming.held"), 15 - before);
  EXPECT_GT(before, 0);
}

/// 20 s in which four vehicles roam at random under load. The number of calls must not matter.
std::vector<Instant> restless(bool waits, int step_ms) {
  MediumSettings settings = two_access_points(waits, 30.0);
  settings.queue = 10;
  settings.lifetime_ms = 100.0;
  settings.background = {{.stations = 2, .rate_hz = 50.0, .down = true}};
  RoamingRig rig(settings);
  for (int i = 0; i < 4; ++i) rig.medium->add_vehicle(fmt::format("AGV{}", i));
  RandomEngine random(7);
  std::uint64_t sent = 0;
  for (int t = 0; t < 20'000; t += 5) {
    for (int s = t - 5; s < t && s > 0; s += step_ms) rig.medium->advance(at_ms(s));
    const auto vehicle = static_cast<std::size_t>(4 * uniform_01(random));
    if (uniform_01(random) < 0.05) {
      rig.medium->on_position(vehicle, uniform_01(random) < 0.5 ? 0.0 : kFar_m, 3.0, at_ms(t));
    }
    rig.medium->send(at_ms(t), vehicle, t % 2 == 0 ? Way::up : Way::down, sent++, 900);
  }
  rig.medium->advance(at_ms(30'000));
  EXPECT_EQ(rig.ends, sent);
  EXPECT_EQ(rig.fates.size(), sent);
  EXPECT_EQ(rig.medium->under_way(), 0U);
  EXPECT_GT(rig.counter("medium.roaming.changes"), 50);
  EXPECT_GT(rig.counter(waits ? "medium.roaming.held" : "medium.roaming.lost"), 50);
  std::vector<Instant> ends;
  for (const auto& [id, fate] : rig.fates) ends.push_back(fate.at);
  return ends;
}

TEST(Roaming, HasOneEndForEveryPacketHoweverOftenItIsAsked) {
  for (const bool waits : {true, false}) EXPECT_EQ(restless(waits, 1), restless(waits, 100));
}

// Along a line between the access points and back, over shadowing that has its ups and downs.
TEST(Roaming, ChangesToAnAccessPointThatIsBetterByMoreThanTheHysteresis) {
  const auto changes = [](double hysteresis_db) {
    RadioSettings settings = two_access_points(true).radio;
    settings.roaming_hysteresis_db = hysteresis_db;
    settings.access_points = {{0.0, 0.0}, {60.0, 0.0}};
    RadioLinks links(settings, 1);
    const std::size_t agv = links.add();
    links.move(agv, 5.0, 5.0);
    links.choose(agv);
    int changes = 0;
    for (int i = 0; i < 500; ++i) {
      const double x_m = 5.0 + 0.2 * (i < 250 ? i : 500 - i);
      const std::size_t before = links.access_point(agv);
      links.move(agv, x_m, 5.0);
      const bool changed = links.choose(agv);
      const double better_db = links.snr_db(agv, 1 - before) - links.snr_db(agv, before);
      EXPECT_EQ(changed, better_db > hysteresis_db);
      EXPECT_EQ(links.access_point(agv), changed ? 1 - before : before);
      changes += changed ? 1 : 0;
    }
    return changes;
  };
  const int many = changes(0.0), few = changes(6.0);
  EXPECT_GE(few, 1);
  EXPECT_LT(few, many);
}

TEST(Roaming, IsNoChangeToComeToTheFirstPlace) {
  RadioLinks links(two_access_points(true).radio, 1);
  const std::size_t agv = links.add();
  links.move(agv, kFar_m, 0.0);
  EXPECT_FALSE(links.choose(agv));
  EXPECT_EQ(links.access_point(agv), 1U);
  links.move(agv, 0.0, 0.0);
  EXPECT_TRUE(links.choose(agv));
}

TEST(RoamingSection, RefusesWhatItDoesNotKnowOrHasNoEffect) {
  const auto refusal = [](const std::string& access_points, const std::string& key) {
    return refusal_of([&] {
      parse_scenario("medium.model = \"dcf\"\n[medium.radio]\nmodel = \"hall\"\naccess_points = " +
                         access_points + "\n" + key,
                     "some.toml");
    });
  };
  EXPECT_EQ(refusal("[[0, 0], [9, 0]]", "roaming_queue = \"lost\""), "accepted");
  EXPECT_THAT(refusal("[[0, 0], [9, 0]]", "roaming_queue = \"drop\""),
              HasSubstr("must be \"wait\" or \"lost\""));
  EXPECT_THAT(refusal("[[0, 0]]", "roaming_break_ms = 5"),
              HasSubstr("medium.radio.roaming_break_ms has no effect: medium.radio.access_points "
                        "has less than two"));
}

}  // namespace
}  // namespace tether
