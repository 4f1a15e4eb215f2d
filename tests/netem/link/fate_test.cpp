#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "netem/relay/make_links.hpp"
#include "tests/support/virtual_world.hpp"

// Common random numbers: the fate of a link's n-th packet is a function of seed, link, n and time.

namespace tether {
namespace {

using test::at_ms;

constexpr int kPackets = 3000;

std::vector<PacketFate> fates_of(Link& link, double period_ms = 1.0) {
  std::vector<PacketFate> fates;
  link.set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  for (int i = 0; i < kPackets; ++i) {
    link.push(at_ms(period_ms * i), {"X", std::vector<std::uint8_t>(50)});
    link.pop_ready(at_ms(period_ms * i), [](const Packet&) {});
  }
  link.set_observer({});
  return fates;
}

Scenario scenario(const std::vector<std::string>& overrides) {
  std::vector<std::string> all{
      "channel.uplink.model=markov", "channel.uplink.markov.mean_good_s=0.3",
      "channel.uplink.markov.mean_bad_s=0.1", "channel.uplink.markov.bad.delay_ms=30"};
  all.insert(all.end(), overrides.begin(), overrides.end());
  return parse_scenario("", "test.toml", all);
}

std::vector<PacketFate> fates_of(const std::vector<std::string>& overrides) {
  LinkPair links = make_links(scenario(overrides));
  return fates_of(links.uplink);
}

const std::vector<std::string> kJitter{
    "channel.uplink.jitter.law=gamma", "channel.uplink.jitter.mean_ms=8",
    "channel.uplink.jitter.sd_ms=4", "channel.uplink.jitter.correlation=0.7"};
const std::vector<std::string> kStages[] = {
    {"channel.uplink.loss=0.2"},
    {"channel.uplink.corrupt.probability=0.2"},
    {"channel.uplink.duplicate.probability=0.3"},
    {"channel.uplink.reorder.probability=0.2"},
    {"channel.uplink.slot.period_ms=20", "channel.uplink.slot.jitter_ms=10"},
    {"channel.uplink.outages=[[0.5, 0.7]]"},
    kJitter};

std::vector<std::string> all_stages_but(const std::vector<std::string>* left_out) {
  std::vector<std::string> keys;
  for (const auto& stage : kStages) {
    if (&stage != left_out) keys.insert(keys.end(), stage.begin(), stage.end());
  }
  return keys;
}

TEST(Fates, AreTheSameInEveryRunOfASeedAndOthersInAnother) {
  const auto first = fates_of(all_stages_but(nullptr));
  const auto again = fates_of(all_stages_but(nullptr));
  auto keys = all_stages_but(nullptr);
  keys.emplace_back("run.seed=2");
  const auto other = fates_of(keys);
  int same = 0;
  for (std::size_t n = 0; n < kPackets; ++n) {
    EXPECT_EQ(first[n].departure, again[n].departure);
    EXPECT_EQ(first[n].outcome, again[n].outcome);
    same += first[n].departure == other[n].departure ? 1 : 0;
  }
  EXPECT_LT(same, kPackets / 2);
}

TEST(Fates, ByTheStateDoNotDependOnAnyStage) {
  const auto plain = fates_of({});
  for (const auto& stage : kStages) {
    const auto staged = fates_of(stage);
    for (std::size_t n = 0; n < kPackets; ++n) {
      EXPECT_EQ(staged[n].state, plain[n].state);
      if (plain[n].outcome == PacketFate::Outcome::lost) {
        EXPECT_NE(staged[n].outcome, PacketFate::Outcome::under_way) << stage[0] << ", " << n;
      } else if (stage[0].find("loss") == std::string::npos) {
        EXPECT_NE(staged[n].outcome, PacketFate::Outcome::lost) << stage[0] << ", " << n;
      }
    }
  }
}

TEST(Fates, OfAStageDoNotDependOnTheOtherStages) {
  const auto all = fates_of(all_stages_but(nullptr));
  const auto corrupt = fates_of(kStages[1]), duplicate = fates_of(kStages[2]);
  const auto reorder = fates_of(kStages[3]);
  int compared = 0;
  for (std::size_t n = 0; n < kPackets; ++n) {
    if (all[n].outcome != PacketFate::Outcome::under_way) continue;
    EXPECT_EQ(all[n].corrupted, corrupt[n].corrupted);
    EXPECT_EQ(all[n].duplicated, duplicate[n].duplicated);
    EXPECT_EQ(all[n].reordered, reorder[n].reordered);
    ++compared;
  }
  EXPECT_GT(compared, kPackets / 4);
}

TEST(Fates, DelaysDoNotDependOnLossesAndCopies) {
  const auto plain = fates_of(kJitter);
  auto keys = kJitter;
  keys.insert(keys.end(), {"channel.uplink.loss=0.5", "channel.uplink.duplicate.probability=0.5",
                           "channel.uplink.corrupt.probability=0.5"});
  const auto other = fates_of(keys);
  for (std::size_t n = 0; n < kPackets; ++n) {
    if (other[n].outcome == PacketFate::Outcome::under_way) {
      EXPECT_EQ(other[n].departure, plain[n].departure);
    }
  }
}

TEST(Fates, OfOneLinkDoNotDependOnTheOther) {
  const std::vector<std::string> keys{
      "channel.downlink.model=gilbert_elliott", "channel.downlink.gilbert_elliott.p=0.1",
      "channel.downlink.gilbert_elliott.r=0.3", "channel.downlink.jitter.law=normal",
      "channel.downlink.jitter.sd_ms=5"};
  LinkPair alone = make_links(scenario(keys));
  const auto expected = fates_of(alone.downlink);
  auto more = keys;
  for (const auto& stage : kStages) more.insert(more.end(), stage.begin(), stage.end());
  LinkPair both = make_links(scenario(more));
  fates_of(both.uplink);
  const auto actual = fates_of(both.downlink);
  for (std::size_t n = 0; n < kPackets; ++n) {
    EXPECT_EQ(actual[n].departure, expected[n].departure);
  }
}

TEST(Fates, OfModelsPerPacketFollowThePacketsNumberNotTheTime) {
  const std::vector<std::string> models[] = {
      {"channel.uplink.model=gilbert_elliott", "channel.uplink.gilbert_elliott.prr=0.6",
       "channel.uplink.gilbert_elliott.mean_burst=4"},
      {"channel.uplink.model=four_state", "channel.uplink.four_state.p13=0.1"}};
  for (const auto& keys : models) {
    LinkPair slow = make_links(parse_scenario("", "x", keys));
    LinkPair fast = make_links(parse_scenario("", "x", keys));
    const auto expected = fates_of(slow.uplink, 100.0), actual = fates_of(fast.uplink, 0.5);
    for (std::size_t n = 0; n < kPackets; ++n) {
      EXPECT_EQ(actual[n].outcome, expected[n].outcome);
      EXPECT_EQ(actual[n].state, expected[n].state);
    }
  }
}

TEST(Fates, AnOutageChangesNothingAfterItsEnd) {
  const auto plain = fates_of(kJitter);
  auto keys = kJitter;
  keys.emplace_back("channel.uplink.outages=[[0.5, 0.7]]");
  const auto other = fates_of(keys);
  for (std::size_t n = 0; n < kPackets; ++n) {
    const bool out = n >= 500 && n < 700;
    EXPECT_EQ(other[n].outcome == PacketFate::Outcome::outage, out);
    EXPECT_TRUE(out || other[n].departure == plain[n].departure) << n;
  }
}

}  // namespace
}  // namespace tether
