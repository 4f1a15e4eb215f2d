#include "common/base/pattern.hpp"

#include <gmock/gmock.h>

#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Optional;

std::string refusal(const std::string& expression) {
  return refusal_of([&] { Pattern{expression}; });
}

TEST(Pattern, MatchesWholeTexts) {
  const Pattern pattern("CAM_(LEFT|RIGHT)|X");
  EXPECT_TRUE(pattern.matches("CAM_LEFT"));
  EXPECT_TRUE(pattern.matches("X"));
  for (const char* text : {"", "CAM_", "CAM_LEFTX", "XCAM_LEFT", "CAM_LEFT\n"}) {
    EXPECT_FALSE(pattern.matches(text)) << text;
  }
}

TEST(Pattern, ReplacesByGroupsTheWholeTextAndDollars) {
  const Pattern pattern("(A|B)/(x)?(\\w+)");
  EXPECT_EQ(pattern.group_count(), 3U);
  EXPECT_THAT(pattern.groups("A/POSE"), Optional(ElementsAre("A", "", "POSE")));
  EXPECT_THAT(pattern.replaced("A/POSE", "$3/of$1$$[$2]<$&>"),
              Optional(std::string("POSE/ofA$[]<A/POSE>")));
  EXPECT_THAT(pattern.replaced("B/C", "$03$011"), Optional(std::string("CB1")));
  EXPECT_EQ(pattern.replaced("C/POSE", "$1"), std::nullopt);
}

TEST(Pattern, ComparesBytes) {
  const std::string name = "\xff\xc3\xa4";
  EXPECT_TRUE(Pattern("...").matches(name));
  EXPECT_TRUE(Pattern("\\xff\xc3\xa4").matches(name));
  EXPECT_THAT(Pattern("(.)(.*)").replaced(name, "$2"), Optional(std::string("\xc3\xa4")));
}

// By backtracking each of these takes longer than anybody waits: 2^40 ways to divide 40 letters.
TEST(Pattern, NoTextTakesLong) {
  const std::string hostile = std::string(62, 'a') + "!";
  for (const char* expression :
       {"(a+)+$", "(a*)*b", "(a|a)*b", "(a|aa)+$", "(.*)*x", "(.*a){20}b", "(a?){40}a{40}b"}) {
    const Pattern pattern(expression);
    EXPECT_FALSE(pattern.matches(hostile)) << expression;
    EXPECT_EQ(pattern.groups(hostile), std::nullopt) << expression;
    EXPECT_EQ(pattern.replaced(hostile, "$1"), std::nullopt) << expression;
  }
}

TEST(Pattern, WhatItCannotDoIsRefusedWithTheReason) {
  for (const char* expression : {"(?!NET/).*", "(?=A).*", "(?<!A)B", "(A)\\1"}) {
    EXPECT_THAT(refusal(expression),
                AllOf(HasSubstr('"' + std::string(expression) + "\" is not a regular expression: "),
                      HasSubstr("there is no looking around")))
        << expression;
  }
  EXPECT_THAT(refusal("FOO("), HasSubstr("\"FOO(\" is not a regular expression: missing )"));
  EXPECT_THAT(refusal("[z-a]"), HasSubstr("invalid character class range: z-a"));
  EXPECT_THAT(refusal("\\q"), HasSubstr("invalid escape sequence: \\q"));
  EXPECT_THAT(refusal("((a{1000}){1000}){1000}"), HasSubstr("is not a regular expression: "));
}

}  // namespace
}  // namespace tether
