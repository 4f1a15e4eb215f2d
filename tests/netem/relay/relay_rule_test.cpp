#include "netem/relay/relay_rule.hpp"

#include <gmock/gmock.h>

#include <string>
#include <utility>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

const std::string kOwnUrl = "udpm://239.255.76.67:7667?ttl=0";
const std::string kBuffer = "&recv_buf_size=2097152";  // added by checked_lcm_url()
const std::string kOtherUrl = "udpm://239.255.76.67:7668?ttl=0";

Scenario scenario() {
  return parse_scenario("", "test.toml",
                        {"channel.links.sat.delay_ms=300", "channel.links.lab.model=map",
                         "channel.links.lab.map.access_points=[[0, 0]]"});
}

RelayRule parse(const std::string& text) {
  return parse_relay_rules({text}, kOwnUrl, scenario()).at(0);
}

std::string refusal(const std::vector<std::string>& texts, const std::string& own = kOwnUrl) {
  return refusal_of([&] { parse_relay_rules(texts, own, scenario()); });
}

TEST(RelayRule, HasUrlPatternNameAndLink) {
  const RelayRule rule =
      parse("udpm://239.255.76.67:7668?ttl=1:CAM_(.*) → udpm://239.255.76.67:7669:X_$1 via sat");
  EXPECT_EQ(rule.source_url, "udpm://239.255.76.67:7668?ttl=1" + kBuffer);
  EXPECT_EQ(rule.pattern, "CAM_(.*)");
  EXPECT_EQ(rule.destination_url, "udpm://239.255.76.67:7669?recv_buf_size=2097152");
  EXPECT_EQ(rule.rename, "X_$1");
  EXPECT_EQ(rule.link, "sat");
}

TEST(RelayRule, NeedsNoUrlAndNoBlanksAroundAnAsciiArrow) {
  const RelayRule rule = parse("FOO->BAR via uplink");
  EXPECT_EQ(rule.source_url, kOwnUrl + kBuffer);
  EXPECT_EQ(rule.destination_url, kOwnUrl + kBuffer);
  EXPECT_EQ(rule.pattern, "FOO");
  EXPECT_EQ(rule.rename, "BAR");
}

TEST(RelayRule, KeepsTheNameWhereOnlyAUrlStandsBehindTheArrow) {
  for (const char* colon : {"", ":"}) {
    const RelayRule rule = parse("(A|B)C -> " + kOtherUrl + colon + " via downlink");
    EXPECT_EQ(rule.destination_url, kOtherUrl + kBuffer);
    EXPECT_EQ(ChannelMap(rule).map("AC"), "AC");
  }
}

TEST(RelayRule, TheUrlEndsAtItsSecondColonSoThatPatternsMayHaveColons) {
  EXPECT_EQ(parse(kOtherUrl + ":(?:A|B):C -> D via uplink").pattern, "(?:A|B):C");
  EXPECT_EQ(parse("(?:A|B):C -> D via uplink").pattern, "(?:A|B):C");
  EXPECT_EQ(parse("A -> " + kOtherUrl + ":B:C via uplink").rename, "B:C");
}

TEST(RelayRule, TheLastViaIsTheOne) {
  const RelayRule rule = parse("A via B -> C via D via sat");
  EXPECT_EQ(rule.pattern, "A via B");
  EXPECT_EQ(rule.rename, "C via D");
  EXPECT_EQ(rule.link, "sat");
}

TEST(RelayRule, ThePatternMustMatchTheWholeNameAndGroupsAreReplaced) {
  const ChannelMap map(parse("(A|B)/(\\w+) -> $2/of$1$$ via uplink"));
  EXPECT_EQ(map.map("A/POSE"), "POSE/ofA$");
  EXPECT_EQ(map.map("A/POSE/X"), std::nullopt);
  EXPECT_EQ(map.map("XA/POSE"), std::nullopt);
  EXPECT_EQ(map.map(""), std::nullopt);
}

TEST(RelayRule, IsShownOnALineAsItWasUnderstood) {
  EXPECT_EQ(to_text(parse("FOO->BAR via uplink")),
            "\"FOO\" on 239.255.76.67:7667 → as \"BAR\" on 239.255.76.67:7667, via uplink");
  EXPECT_EQ(to_text(parse("FOO -> " + kOtherUrl + " via sat")),
            "\"FOO\" on 239.255.76.67:7667 → as it is on 239.255.76.67:7668, via sat");
}

TEST(RelayRule, WhatIsMalformedIsRefusedInOneLineWithAnExample) {
  const std::pair<const char*, const char*> cases[] = {
      {"", "must end with \" via LINK\""},
      {"FOO -> BAR", "must end with \" via LINK\""},
      {"FOO BAR via uplink", "no arrow, -> or →"},
      {"A -> B → C via uplink", "two arrows"},
      {"A->B->C via uplink", "two arrows"},
      {"-> BAR via uplink", "no channel pattern before the arrow"},
      {"udpm://239.255.76.67:7668 -> BAR via uplink", "no channel pattern before the arrow"},
      {"FOO -> via uplink", "nothing behind the arrow"},
      {"FOO( -> BAR via uplink", "\"FOO(\" is not a regular expression"},
      {"[z-a] -> BAR via uplink", "\"[z-a]\" is not a regular expression"},
      {"FOO -> BAR_$1 via uplink", "\"BAR_$1\": $1 means nothing"},
      {"(F)OO -> BAR_$2 via uplink", "$2 means nothing: allowed are $1 … for the 1 group of"},
      {"(F)OO -> BAR_$ via uplink", "$ means nothing"},
      {"FOO -> BAR via sta", "no link \"sta\"; there are uplink, downlink, lab, sat"},
      {"FOO -> BAR via ", "no link \"\""},
      {"FOO -> BAR via lab", "link \"lab\" has model = \"map\""},
      {"memq://:FOO -> BAR via uplink", "rules can use udpm:// only"},
      {"file:///tmp/x.log:FOO -> BAR via uplink", "rules can use udpm:// only"},
      {"FOO -> tcpq://localhost:7700:BAR via uplink", "rules can use udpm:// only"},
      {"udpm://239.255.76.67:FOO -> BAR via uplink", "port \"FOO\" is not a number"},
      {"udpm://10.0.0.1:7667:FOO -> BAR via uplink", "10.0.0.1 is not a multicast group"},
      {"udpm://239.255.76.67:7668?tll=1:FOO -> BAR via uplink", "bad option \"tll=1\""}};
  for (const auto& [rule, why] : cases) {
    EXPECT_THAT(refusal({rule}),
                AllOf(HasSubstr("--rule \"" + std::string(rule) + "\": "), HasSubstr(why),
                      HasSubstr("such as --rule '"), Not(HasSubstr("\n"))));
  }
  EXPECT_THAT(refusal({"A -> B via uplink"}, "tcpq://localhost:7700"), HasSubstr("udpm:// only"));
}

TEST(RelayRule, ANameThatIsTooLongForAChannelIsRefused) {
  EXPECT_THAT(refusal({"F -> " + std::string(64, 'x') + " via uplink"}),
              HasSubstr("xxx\" is too long for a channel: at most 63 bytes"));
  EXPECT_EQ(refusal({"F -> " + std::string(63, 'x') + " via uplink"}), "accepted");
}

TEST(RelayRule, AnObviousLoopIsRefused) {
  for (const char* rule :
       {"FOO -> FOO via uplink", "F.* -> FOO via uplink", ".* -> X via uplink",
        "FOO -> $& via uplink", "FOO -> udpm://239.255.76.67:7667?ttl=0 via uplink"}) {
    EXPECT_THAT(refusal({rule}), HasSubstr("a loop: ")) << rule;
  }
  EXPECT_EQ(refusal({"FOO -> FOO2 via uplink"}), "accepted");
  EXPECT_EQ(refusal({"FOO -> " + kOtherUrl + ":FOO via uplink"}), "accepted");
  EXPECT_EQ(refusal({"FOO -> " + kOtherUrl + " via uplink", kOtherUrl + ":FOO -> FOO via uplink"}),
            "accepted");
}

TEST(RelayRule, NetworksThatLcmCannotTellApartAreRefused) {
  EXPECT_THAT(refusal({"A -> udpm://239.255.76.68:7667?ttl=0:B via uplink"}),
              HasSubstr("have the same port"));
  EXPECT_THAT(refusal({"A -> " + kOtherUrl + ":B via uplink",
                       "udpm://239.255.76.68:7668?ttl=0:A -> B via uplink"}),
              HasSubstr("have the same port"));
  EXPECT_THAT(refusal({"A -> udpm://239.255.76.67:7667:B via uplink"}),
              HasSubstr("are the same network: write it the same way"));
}

}  // namespace
}  // namespace tether
