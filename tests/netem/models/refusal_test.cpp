#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <vector>

#include "netem/channel/settings.hpp"
#include "tests/netem/link/channel_rig.hpp"

// Settings that a channel in use does not take: the reason, and that nothing has changed.

namespace tether {
namespace {

using test::at_ms;
using test::channel;
using test::ChannelRig;
using test::Settings;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

const Settings kBegin{"uplink.model=markov",
                      "uplink.markov.mean_good_s=0.3",
                      "uplink.markov.mean_bad_s=0.1",
                      "uplink.loss=0.1",
                      "uplink.corrupt.probability=0.1",
                      "uplink.jitter.law=normal",
                      "uplink.jitter.sd_ms=5",
                      "uplink.jitter.correlation=0.5",
                      "downlink.model=gilbert_elliott",
                      "downlink.gilbert_elliott.prr=0.7",
                      "downlink.gilbert_elliott.mean_burst=3"};

struct RefusedModel {
  Settings settings;
  std::string reason;  ///< a part of it
};

/// All but the first could be done if it were not for the last of each.
std::vector<RefusedModel> refused() {
  const Settings good{"uplink.loss=0.9", "uplink.markov.bad.prr=0.2", "downlink.loss=0.7"};
  std::vector<RefusedModel> list{
      {{"prr"}, "prr: expected KEY=VALUE"},
      {{"uplink.prr=0.5"},
       "settings: channel.uplink.prr has no effect: channel.uplink.model is \"markov\""},
      {{"uplink.markov.bad.prr=1.5"},
       "uplink.markov.bad.prr=1.5: channel.uplink.markov.bad.prr = 1.5 is not allowed: must be a "
       "number in [0, 1]"},
      {{"uplink.los=0.5"}, "unknown key \"uplink.los\" in [channel] (did you mean \"uplink.loss\""},
      {{"run.seed=2"}, "unknown key \"run.seed\" in [channel]"},
      {{"change=[]"}, "cannot be changed"},
      {{"loss=0.1\n0.2"}, "one line"},
      {{std::string(200, 'x') + "=1"}, "at most 128 characters"},
      {{"downlink.gilbert_elliott.mean_burst=1", "downlink.gilbert_elliott.prr=0.3"},
       "is too short for channel.downlink.gilbert_elliott.prr = 0.3"},
      {{"uplink.in_order=true", "uplink.reorder.probability=0.1"}, "contradict each other"},
      {{"shared_state=true"}, "same model"},
      {{"downlink.model=trace"}, "channel.downlink.trace.file is needed"},
      {{"downlink.model=trace", "downlink.trace.file=/nowhere.csv"}, "/nowhere.csv"},
      {{"downlink.model=trace", "downlink.trace.file=/dev/zero"}, "not a regular file"},
      {{"uplink.jitter.law=table", "uplink.jitter.file=/nowhere"},
       "channel.uplink.jitter.file: cannot read the delay table \"/nowhere\""},
      {{"downlink.model=map", "downlink.map.file=/nowhere"},
       "channel.downlink.map.file: cannot read the map \"/nowhere\""},
      {{"downlink.model=chain", "downlink.chain.prr=[1.0, 0.5]",
        "downlink.chain.rates_per_s=[[0, 0], [0, 0]]"},
       "where the chain ends up depends on where it begins"}};
  for (RefusedModel& one : list)
    one.settings.insert(one.settings.begin(), good.begin(), good.end());
  list.push_back({{"=1"}, "expected KEY=VALUE"});
  return list;
}

TEST(Refusal, GivesTheReason) {
  ChannelRig rig(channel(kBegin));
  for (const auto& [settings, reason] : refused()) {
    EXPECT_THAT(rig.refusal(settings), HasSubstr(reason)) << settings.back();
  }
}

std::vector<PacketFate> fates(const std::vector<RefusedModel>& requests) {
  ChannelRig rig(channel(kBegin));
  std::vector<PacketFate> fates;
  for (Link* link : {&rig.links.uplink, &rig.links.downlink}) {
    link->set_observer([&fates](const PacketFate& fate) { fates.push_back(fate); });
  }
  for (int i = 0; i < 2000; ++i) {
    if (i % 50 == 0 && !requests.empty()) {
      const auto& request = requests[static_cast<std::size_t>(i / 50) % requests.size()];
      EXPECT_NE(rig.refusal(request.settings, at_ms(i)), "accepted");
    }
    for (Link* link : {&rig.links.uplink, &rig.links.downlink}) {
      link->push(at_ms(i), {"X", std::vector<std::uint8_t>(50)});
    }
  }
  return fates;
}

TEST(Refusal, ChangesNothingOfWhatPacketsMeet) {
  const auto untouched = fates({}), asked = fates(refused());
  ASSERT_EQ(untouched.size(), 4000U);
  test::expect_same(asked, untouched, 0, untouched.size());
}

TEST(Refusal, LeavesTheSettingsInForce) {
  ChannelRig rig(channel(kBegin));
  const auto before = channel_settings(rig.control.in_force().get<ChannelSettings>());
  for (const auto& [settings, reason] : refused()) rig.refusal(settings);
  EXPECT_EQ(channel_settings(rig.control.in_force().get<ChannelSettings>()), before);
}

TEST(ChannelSettings, AreAnsweredAsTheyAreInForce) {
  ChannelRig rig(channel({}));
  EXPECT_THAT(
      rig.change({"prr=.5"}, tether::kStart),
      ElementsAre(ChannelSetting{"uplink.prr", "0.5"}, ChannelSetting{"downlink.prr", "0.5"}));
  EXPECT_THAT(rig.change({"channel.downlink.prr=0.5"}, at_ms(1)),
              ElementsAre(ChannelSetting{"downlink.prr", "0.5"}));
  EXPECT_THAT(rig.change({"uplink.model=markov", "uplink.markov.p_bad=0.25",
                          "uplink.markov.mean_cycle_s=8"},
                         at_ms(2)),
              ElementsAre(ChannelSetting{"uplink.model", "\"markov\""},
                          ChannelSetting{"uplink.markov.mean_good_s", "6.0"},
                          ChannelSetting{"uplink.markov.mean_bad_s", "2.0"}));
  EXPECT_THAT(
      channel_settings(rig.control.in_force().get<ChannelSettings>()),
      ElementsAre(ChannelSetting{"uplink.model", "\"markov\""}, ChannelSetting{"uplink.prr", "0.5"},
                  ChannelSetting{"uplink.markov.mean_good_s", "6.0"},
                  ChannelSetting{"uplink.markov.mean_bad_s", "2.0"},
                  ChannelSetting{"downlink.prr", "0.5"}));
}

}  // namespace
}  // namespace tether
