#include "netem/channel/change.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "netem/channel/settings.hpp"
#include "netem/models/markov.hpp"
#include "tests/support/refusal.hpp"

// [[channel.change]]: other settings of the channel from some time on.

namespace tether {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

std::string change(const std::string& at_s, const std::string& set) {
  return "[[channel.change]]\nat_s = " + at_s + "\nset = [" + set + "]\n";
}

std::string refusal(const std::string& toml, const std::vector<std::string>& overrides = {}) {
  return refusal_of([&] { parse_scenario(toml, "test.toml", overrides); });
}

TEST(ScenarioChange, IsReadInOrderAndWrittenAgain) {
  const Scenario s = parse_scenario("[channel.uplink]\nprr = 0.9\n" + change("-1", "\"prr=0.5\"") +
                                        change("2.5", "\"model=markov\", \"markov.p_bad=0.5\""),
                                    "test.toml");
  ASSERT_EQ(s.get<ChannelSettings>().changes.size(), 2U);
  EXPECT_EQ(s.get<ChannelSettings>().changes[0].at_s, -1.0);
  EXPECT_THAT(s.get<ChannelSettings>().changes[0].settings, ElementsAre("prr=0.5"));
  EXPECT_THAT(s.get<ChannelSettings>().changes[1].settings,
              ElementsAre("model=markov", "markov.p_bad=0.5"));
  EXPECT_EQ(s.get<ChannelSettings>().uplink.fixed.prr, 0.9);
  EXPECT_EQ(to_toml(parse_scenario(to_toml(s), "again")), to_toml(s));
  EXPECT_THAT(to_toml(s), HasSubstr("[[channel.change]]\nat_s = 2.5\n"));
}

TEST(ScenarioChange, CanBeGivenAndTakenAwayByAnOverride) {
  const std::string toml = change("1", "\"prr=0.5\"");
  const Scenario other =
      parse_scenario(toml, "x", {"channel.change=[{at_s=3, set=[\"loss=0.1\", \"prr=1\"]}]"});
  ASSERT_EQ(other.get<ChannelSettings>().changes.size(), 1U);
  EXPECT_THAT(other.get<ChannelSettings>().changes[0].settings, ElementsAre("loss=0.1", "prr=1"));
  EXPECT_TRUE(
      parse_scenario(toml, "x", {"channel.change=[]"}).get<ChannelSettings>().changes.empty());
}

TEST(ScenarioChange, IsCheckedAgainstTheSettingsInForceByThen) {
  EXPECT_THAT(refusal(change("1", "\"markov.bad.prr=0.1\"")),
              StartsWith("test.toml: channel.change at 1 s: channel.uplink.markov.bad.prr has no "
                         "effect: channel.uplink.model is \"fixed\""));
  EXPECT_EQ(refusal(change("1", "\"model=markov\"") + change("1", "\"markov.bad.prr=0.1\"")),
            "accepted");
  EXPECT_THAT(refusal(change("1", "\"prr=0.3\", \"downlink.prr=1.5\"")),
              StartsWith("test.toml: channel.change at 1 s: downlink.prr=1.5: channel.downlink.prr "
                         "= 1.5 is not allowed: must be a number in [0, 1]"));
  EXPECT_THAT(refusal(change("1", "\"shared_state=true\"") + change("2", "\"uplink.model=map\"")),
              HasSubstr("channel.change at 2 s: channel.shared_state = true needs the same model"));
  EXPECT_THAT(refusal(change("1", "\"run.seed=3\"")), HasSubstr("unknown key"));
}

TEST(ScenarioChange, OfAnotherShapeOrOrderIsRefused) {
  const std::string shape = "test.toml:2: each [[channel.change]] must have at_s";
  for (const char* wrong :
       {"change = 3", "change = [3]", "change = [{at_s = 1}]", "change = [{set = [\"prr=1\"]}]",
        "change = [{at_s = \"1\", set = [\"prr=1\"]}]", "change = [{at_s = 1, set = []}]",
        "change = [{at_s = 1, set = \"prr=1\"}]", "change = [{at_s = 1, set = [1]}]",
        "change = [{at_s = 1e7, set = [\"prr=1\"]}]", "change = [{at_s = nan, set = [\"prr=1\"]}]",
        "change = [{at_s = 1, set = [\"prr=1\"], to = 2}]"}) {
    EXPECT_THAT(refusal(std::string("[channel]\n") + wrong), StartsWith(shape)) << wrong;
  }
  EXPECT_THAT(refusal(change("2", "\"prr=1\"") + change("1.5", "\"prr=0\"")),
              HasSubstr("channel.change at 1.5 s comes after the one at 2 s: times must ascend"));
}

TEST(ScenarioChange, NamesFilesRelativeToTheScenarioOrTheWorkingFolder) {
  const Scenario file = parse_scenario(
      change("1", "\"model=trace\", ' trace.file = \"a b.csv\" ', \"downlink.trace.file=/c.csv\""),
      "folder/x.toml");
  EXPECT_THAT(file.get<ChannelSettings>().changes[0].settings,
              ElementsAre("model=trace", "trace.file=\"folder/a b.csv\"",
                          "downlink.trace.file=\"/c.csv\""));
  const Scenario given = parse_scenario(
      "", "folder/x.toml", {"channel.change=[{at_s=1, set=['model=trace', 'trace.file=b.csv']}]"});
  EXPECT_EQ(given.get<ChannelSettings>().changes[0].settings[1], "trace.file=\"b.csv\"");
  EXPECT_EQ(to_toml(parse_scenario(to_toml(file), "again")), to_toml(file));
}

TEST(ChangeChannel, BeatsWhatIsInForceInEitherForm) {
  const Scenario s = parse_scenario(
      "", "x",
      {"channel.model=markov", "channel.markov.mean_good_s=6", "channel.markov.mean_bad_s=2"});
  const ChannelSettings half =
      change_channel(s.get<ChannelSettings>(), {"downlink.markov.p_bad=0.5"}).channel;
  EXPECT_EQ(half.downlink.own.get<MarkovConfig>().mean_good_s, 4.0);
  EXPECT_EQ(half.downlink.own.get<MarkovConfig>().mean_bad_s, 4.0);
  EXPECT_EQ(half.uplink.own.get<MarkovConfig>().mean_bad_s, 2.0);
  EXPECT_EQ(change_channel(half, {"markov.mean_bad_s=1"})
                .channel.downlink.own.get<MarkovConfig>()
                .mean_good_s,
            4.0);
}

}  // namespace
}  // namespace tether
