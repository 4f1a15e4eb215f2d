#include "netem/medium/shared_medium.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>

#include "common/base/errors.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::HasSubstr;

/// A medium whose packets' fates can be looked up.
struct RadioRig {
  explicit RadioRig(const MediumSettings& settings)
      : medium(SharedMedium::make(
            settings, 1, [this](const PacketFateOnAir& fate) { fates[fate.id] = fate; })) {}
  void run_until(Instant end) {
    while (medium->next_event() <= end) medium->advance(medium->next_event());
  }
  std::map<std::uint64_t, PacketFateOnAir> fates;
  std::unique_ptr<SharedMedium> medium;
};

TEST(SharedMedium, CutsPacketsIntoFramesOfEthernet) {
  EXPECT_THAT(fragment_bytes(80), ElementsAre(80 + 8 + 20));
  EXPECT_THAT(fragment_bytes(1472), ElementsAre(1500));
  EXPECT_THAT(fragment_bytes(1473), ElementsAre(1500, 21));
  EXPECT_THAT(fragment_bytes(3288), ElementsAre(1500, 1500, 336 + 20));
}

/// Fates of 400 packets both ways of the first six of `vehicles`; each packet has one attempt.
std::map<std::uint64_t, bool> fates_of_six(std::size_t vehicles, Duration apart) {
  MediumSettings settings{.model = MediumSettings::Model::dcf, .attempts = 1, .error_ratio = 0.3};
  RadioRig rig(settings);
  for (std::size_t i = 0; i < vehicles; ++i) rig.medium->add_vehicle(fmt::format("AGV{}", i + 1));
  for (std::uint64_t round = 0; round < 400; ++round) {
    for (std::uint64_t i = 0; i < vehicles; ++i) {
      const Instant now = kStart + round * milliseconds{50} + static_cast<std::int64_t>(i) * apart;
      rig.run_until(now);
      rig.medium->send(now, i, round % 2 == 0 ? Way::up : Way::down, round * 100 + i, 80);
    }
  }
  rig.run_until(kStart + std::chrono::seconds{100});
  std::map<std::uint64_t, bool> six;
  for (const auto& [id, fate] : rig.fates) {
    if (id % 100 < 6) six[id] = fate.delivered;
  }
  return six;
}

std::int64_t differences(const std::map<std::uint64_t, bool>& a,
                         const std::map<std::uint64_t, bool>& b) {
  std::int64_t all = 0;
  for (const auto& [id, delivered] : a) all += delivered != b.at(id) ? 1 : 0;
  return all;
}

TEST(SharedMedium, SixMoreVehiclesChangeNoFateOfTheFirstSixWhereTheyDoNotMeet) {
  const auto alone = fates_of_six(6, milliseconds{4});
  EXPECT_EQ(alone.size(), 2400U);
  EXPECT_EQ(differences(alone, fates_of_six(12, milliseconds{4})), 0);
}

// A collision takes the air from those in it, and the luck with noise from none.
TEST(SharedMedium, SixMoreVehiclesChangeOnlyFatesOfFramesThatCollide) {
  const std::int64_t changed =
      differences(fates_of_six(6, Duration{0}), fates_of_six(12, Duration{0}));
  EXPECT_GT(changed, 0);
  EXPECT_LE(changed, 240) << "a tenth; if they drew in turn, 2 * 0.3 * 0.7 = 42 % would change";
}

class EachMedium : public testing::TestWithParam<MediumSettings::Model> {
 protected:
  MediumSettings settings() const { return {.model = GetParam()}; }
};

TEST_P(EachMedium, CarriesAPacketBothWays) {
  RadioRig rig(settings());
  const std::size_t agv = rig.medium->add_vehicle("AGV");
  rig.medium->send(kStart, agv, Way::up, 1, 80);
  rig.medium->send(kStart, agv, Way::down, 2, 3288);
  EXPECT_EQ(rig.medium->under_way(), 2U);
  rig.run_until(kStart + milliseconds{1000});
  EXPECT_TRUE(rig.fates.at(1).delivered);
  EXPECT_TRUE(rig.fates.at(2).delivered);
  EXPECT_EQ(rig.medium->next_event(), Instant::max());
}

TEST_P(EachMedium, LosesAPacketIfOneOfItsFragmentsIsLost) {
  MediumSettings lossy = settings();
  lossy.error_ratio = 0.5;
  lossy.attempts = 1;
  RadioRig rig(lossy);
  const std::size_t agv = rig.medium->add_vehicle("AGV");
  int small = 0, large = 0;
  for (std::uint64_t i = 0; i < 2000; ++i) {
    const Instant now = kStart + i * milliseconds{100};
    rig.run_until(now);
    rig.medium->send(now, agv, Way::up, i, i % 2 == 0 ? 80 : 3288);
  }
  rig.run_until(kStart + milliseconds{1'000'000});
  for (const auto& [id, fate] : rig.fates) (id % 2 == 0 ? small : large) += fate.delivered ? 1 : 0;
  // 1000 of each: 1/2 and 1/8, standard deviations 16 and 10; four of them.
  EXPECT_NEAR(small, 500, 64);
  EXPECT_NEAR(large, 125, 42);
}

TEST_P(EachMedium, HasAnEndForEveryPacketUnderOverload) {
  MediumSettings loaded = settings();
  loaded.rate_Mbps = 6.0;
  loaded.control_rate_Mbps = 6.0;
  loaded.queue = 10;
  loaded.background = {{.kind = MediumSettings::Background::Kind::poisson,
                        .stations = 5,
                        .rate_hz = 200.0,
                        .bytes = 1400}};
  RadioRig rig(loaded);
  for (int i = 0; i < 10; ++i) rig.medium->add_vehicle(fmt::format("AGV{}", i));
  for (std::uint64_t i = 0; i < 5000; ++i) {
    const Instant now = kStart + i * milliseconds{1};
    rig.run_until(now);
    rig.medium->send(now, i % 10, i % 3 == 0 ? Way::down : Way::up, i, 900);
  }
  rig.run_until(kStart + milliseconds{60'000});
  EXPECT_EQ(rig.medium->under_way(), 0U);
  EXPECT_EQ(rig.fates.size(), 5000U);
  int lost = 0;
  for (const auto& [id, fate] : rig.fates) lost += fate.delivered ? 0 : 1;
  EXPECT_GT(lost, 500);
  EXPECT_LT(lost, 5000);
}

// The listener decides when advance() is called; that must not matter.
TEST_P(EachMedium, DoesTheSameHoweverOftenItIsAsked) {
  MediumSettings busy = settings();
  busy.background = {{.kind = MediumSettings::Background::Kind::periodic,
                      .stations = 3,
                      .rate_hz = 100.0,
                      .bytes = 400}};
  const auto run = [&busy](milliseconds step) {
    RadioRig rig(busy);
    const std::size_t agv = rig.medium->add_vehicle("AGV");
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Instant now = kStart + i * milliseconds{50};
      for (Instant t = now - milliseconds{50}; t < now; t += step) {
        if (t >= kStart) rig.medium->advance(t);
      }
      rig.medium->send(now, agv, Way::up, i, 80);
    }
    rig.medium->advance(kStart + milliseconds{20'000});
    std::vector<Instant> ends;
    for (const auto& [id, fate] : rig.fates) ends.push_back(fate.at);
    return ends;
  };
  EXPECT_EQ(run(milliseconds{1}), run(milliseconds{50}));
}

// Nine other vehicles as traffic: what one of ten has of the radio.
TEST_P(EachMedium, IsSharedWithWhatTheAccessPointSendsToOthers) {
  const auto mean_delay = [this](std::int64_t others) {
    MediumSettings shared = settings();
    shared.rate_Mbps = 6.0;
    shared.control_rate_Mbps = 6.0;
    if (others > 0) {
      shared.background = {{.kind = MediumSettings::Background::Kind::periodic,
                            .stations = others,
                            .rate_hz = 100.0,
                            .bytes = 400,
                            .down = true}};
    }
    RadioRig rig(shared);
    const std::size_t agv = rig.medium->add_vehicle("AGV");
    Duration sum{};
    for (std::uint64_t i = 0; i < 500; ++i) {
      const Instant now = kStart + i * milliseconds{37};
      rig.run_until(now);
      rig.medium->send(now, agv, Way::down, i, 80);
      rig.run_until(now + milliseconds{37});
      sum += rig.fates.at(i).at - now;
    }
    return sum / 500;
  };
  EXPECT_GT(mean_delay(9), mean_delay(0) + std::chrono::microseconds{200});
}

INSTANTIATE_TEST_SUITE_P(Models, EachMedium,
                         testing::Values(MediumSettings::Model::dcf, MediumSettings::Model::edca,
                                         MediumSettings::Model::scheduled),
                         [](const auto& tested) {
                           switch (tested.param) {
                             case MediumSettings::Model::dcf:
                               return "dcf";
                             case MediumSettings::Model::edca:
                               return "edca";
                             default:
                               return "scheduled";
                           }
                         });

// 1400 bytes at 6 Mbit/s take 2 ms, so 800 of them a second fill the queue that they are in.
TEST(SharedMedium, LetsAnAccessPointSendWhatIsUrgentFirst) {
  const auto delivered = [](const std::string& category) {
    RadioRig rig({.model = MediumSettings::Model::edca,
                  .rate_Mbps = 6.0,
                  .control_rate_Mbps = 6.0,
                  .category = category,
                  .background = {{.rate_hz = 800.0, .category = "BE", .down = true}}});
    rig.medium->add_vehicle("AGV");
    for (std::uint64_t i = 0; i < 100; ++i) {
      rig.run_until(kStart + i * milliseconds{50});
      rig.medium->send(kStart + i * milliseconds{50}, 0, Way::down, i, 80);
    }
    rig.run_until(kStart + milliseconds{10'000});
    return std::count_if(rig.fates.begin(), rig.fates.end(),
                         [](const auto& fate) { return fate.second.delivered; });
  };
  EXPECT_EQ(delivered("VO"), 100);
  EXPECT_LT(delivered("BE"), 90);
}

TEST(SharedMedium, IsNoneUnlessAskedFor) {
  EXPECT_EQ(SharedMedium::make({}, 1, [](const PacketFateOnAir&) {}), nullptr);
}

// 54 Mbit/s, 100 bytes each way 20 times a second: about 100 µs a frame.
TEST(SharedMedium, KnowsTheLoadThatPacketsAre) {
  MediumSettings wifi{.model = MediumSettings::Model::edca};
  wifi.up = wifi.down = {20.0, 100};
  const double one = offered_load(wifi).least;
  EXPECT_NEAR(one, 40 * 125e-6, 40 * 30e-6);
  wifi.others = 9;
  EXPECT_DOUBLE_EQ(offered_load(wifi).least, 10 * one);
  EXPECT_EQ(medium_warning(wifi), "");
  wifi.others = 499;
  EXPECT_EQ(medium_warning(wifi),
            fmt::format("[medium] is asked for {:.0f} % of its time, collisions not counted: it "
                        "cannot carry all",
                        50'000 * one));
  wifi.model = MediumSettings::Model::none;
  EXPECT_EQ(offered_load(wifi).most, 0.0);
}

// One more that sends where the others are silent. They begin at the same instant, collide, and
// draw. The beginning of the slots shifts both equally.
TEST_P(EachMedium, GivesAVehicleMoreNoPartInTheLuckOfTheOthers) {
  const auto fates = [](const MediumSettings& settings, bool has_more) {
    RadioRig rig(settings);
    for (const char* name : {"AGV1", "AGV2"}) rig.medium->add_vehicle(name);
    if (has_more) rig.medium->add_vehicle("AGV3");
    for (std::uint64_t i = 0; i < 200; ++i) {
      const Instant at = kStart + static_cast<std::int64_t>(i) * milliseconds{200};
      rig.run_until(at);
      for (const std::size_t vehicle : {0U, 1U}) {
        rig.medium->send(at, vehicle, Way::up, 10 * i + vehicle, 80);
      }
      rig.run_until(at + milliseconds{60});
      if (has_more) rig.medium->send(at + milliseconds{60}, 2, Way::up, 10 * i + 2, 80);
    }
    rig.run_until(kStart + milliseconds{41'000});
    std::vector<std::tuple<bool, bool, Duration>> all;
    for (std::uint64_t i = 0; i < 200; ++i) {
      const auto &one = rig.fates.at(10 * i), &other = rig.fates.at(10 * i + 1);
      all.emplace_back(one.delivered, other.delivered, other.at - one.at);
    }
    return all;
  };
  MediumSettings lossy = settings();
  lossy.error_ratio = 0.3;
  const auto two = fates(lossy, false);
  EXPECT_GT(std::set(two.begin(), two.end()).size(), 5U) << "there is luck";
  EXPECT_TRUE(two == fates(lossy, true));
}

// Whatever a program sends to a relay.
TEST(SharedMedium, LosesWhatNoDatagramHolds) {
  RadioRig rig({.model = MediumSettings::Model::dcf});
  const std::size_t agv = rig.medium->add_vehicle("AGV");
  rig.medium->send(kStart, agv, Way::up, 1, 65'507);
  rig.medium->send(kStart, agv, Way::up, 2, 65'508);
  EXPECT_FALSE(rig.fates.at(2).delivered);
  rig.run_until(kStart + milliseconds{1000});
  EXPECT_TRUE(rig.fates.at(1).delivered);
  CounterList counters;
  rig.medium->list(counters);
  EXPECT_THAT(counters, testing::Contains(testing::Pair("medium.too_long", 1)));
}

// Each of ten others sends and gets as many packets as said.
TEST_P(EachMedium, HasOtherVehiclesToo) {
  MediumSettings crowd = settings();
  crowd.others = 10;
  crowd.up = {20.0, 80};
  crowd.down = {10.0, 80};
  RadioRig rig(crowd);
  rig.medium->add_vehicle("AGV");
  rig.medium->send(kStart, 0, Way::up, 1, 80);
  rig.medium->advance(kStart + milliseconds{10'000});
  CounterList counters;
  rig.medium->list(counters);
  std::int64_t transmissions = 0, collisions = 0;
  for (const auto& [name, value] : counters) {
    if (name.ends_with("transmissions")) transmissions += value;
    if (name == "medium.collisions") collisions = value;
  }
  // A collision is one transmission less and two more attempts.
  EXPECT_NEAR(transmissions - collisions, 10 * 10 * 30 + 1, 10 * 2);
}

class MediumSection : public testing::Test {
 protected:
  static MediumSettings read(const std::string& toml) {
    return parse_scenario(toml, "some.toml").get<MediumSettings>();
  }
  static std::string refusal(const std::string& toml) {
    try {
      parse_scenario(toml, "some.toml");
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(MediumSection, ReadsOtherStations) {
  const MediumSettings medium = read(
      "medium.model = \"edca\"\n[[medium.background]]\nkind = \"saturated\"\nstations = 3\n"
      "category = \"VI\"\n");
  ASSERT_EQ(medium.background.size(), 1U);
  EXPECT_EQ(medium.background[0].stations, 3);
  EXPECT_EQ(medium.background[0].category, "VI");
}

TEST_F(MediumSection, WritesWhatItReads) {
  const std::string toml =
      "medium.model = \"scheduled\"\nmedium.slot_ms = 1.0\n[[medium.background]]\nkind = "
      "\"periodic\"\nrate_hz = 25\n[[medium.background]]\nway = \"down\"\n";
  const Scenario once = parse_scenario(toml, "some.toml");
  EXPECT_EQ(to_toml(parse_scenario(to_toml(once), "some.toml")), to_toml(once));
  EXPECT_THAT(to_toml(once), HasSubstr("rate_hz = 25.0"));
}

TEST_F(MediumSection, SaysNothingOfAMediumThatIsNotThere) {
  EXPECT_EQ(to_toml(parse_scenario("", "some.toml")).find("medium"), std::string::npos);
}

TEST_F(MediumSection, RefusesWhatItDoesNotKnow) {
  EXPECT_THAT(refusal("medium.model = \"csma\""),
              HasSubstr("must be \"none\" or \"dcf\" or \"edca\" or \"scheduled\""));
  EXPECT_THAT(refusal("medium.model = \"edca\"\n[[medium.background]]\nkind = \"loud\"\n"),
              HasSubstr("each [[medium.background]] may have kind = "));
  EXPECT_THAT(refusal("medium.model = \"dcf\"\nmedium.category = \"VO\""),
              HasSubstr("medium.model is \"dcf\""));
  EXPECT_THAT(refusal("medium.model = \"scheduled\"\nmedium.preset = \"nokia\""),
              HasSubstr("must be \"none\" or \"srsran\" or \"oai\""));
  EXPECT_THAT(refusal("medium.queue = 5"), HasSubstr("medium.model is \"none\""));
  EXPECT_THAT(refusal("[[medium.background]]\nkind = \"poisson\"\n"),
              HasSubstr("[[medium.background]] has no effect: medium.model is \"none\""));
}

TEST_F(MediumSection, RefusesAQueueThatAPlanDoesNotFitInto) {
  EXPECT_THAT(refusal("medium.model = \"dcf\"\nmedium.queue = 2\ncontroller.law = "
                      "\"predictive_consistent\"\nactuator.policy = \"horizon\"\n"),
              HasSubstr("medium.queue = 2 is too short for a command or plan of 33"));
}

TEST_F(MediumSection, KnowsWhatTheScenariosVehiclesSend) {
  const MediumSettings medium = read(
      "medium.model = \"dcf\"\nsensor.rate_hz = 5\ncontroller.trigger = \"timer\"\n"
      "controller.rate_hz = 15\n");
  EXPECT_EQ(medium.up.rate_hz, 5.0);
  EXPECT_EQ(medium.down.rate_hz, 15.0);
  EXPECT_GT(medium.up.bytes, medium.down.bytes);  // a pose, and a twist
}

TEST_F(MediumSection, TakesFromAPresetWhatIsNotGiven) {
  const MediumSettings cell = read(
      "medium.model = \"scheduled\"\nmedium.preset = \"oai\"\nmedium.request_period_ms = 5.0\n");
  EXPECT_EQ(cell.request_period_ms, 5.0);
  EXPECT_EQ(cell.offset_ms, 2.25);
}

}  // namespace
}  // namespace tether
