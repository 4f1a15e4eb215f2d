#include "link/node/diagnosis.hpp"

#include <gmock/gmock.h>

namespace tether::link {
namespace {

using std::chrono::seconds;
using ::testing::HasSubstr;

/// What is said 5 s after a peer was seen last, when `count` has gone up since.
std::string said_after(std::int64_t Refusals::*count, double clock_ahead_s = 0.0) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight{{}, {"wifi"}, {}, clock_ahead_s};
  EXPECT_FALSE(diagnosis.look(kStart, sight));
  if (count != nullptr) ++(sight.refused.*count);
  return diagnosis.look(kStart + seconds{5}, sight).value_or("nothing");
}

TEST(Diagnosis, SaysWhyAPeerIsDownAndWhatToDo) {
  EXPECT_THAT(said_after(&Refusals::clock, 73.2), HasSubstr("+73.2 s apart"));
  EXPECT_THAT(said_after(&Refusals::version), HasSubstr("same Tether on both hosts"));
  EXPECT_THAT(said_after(&Refusals::address), HasSubstr("`addresses`"));
  EXPECT_THAT(said_after(&Refusals::crossed), HasSubstr("another order"));
  EXPECT_THAT(said_after(&Refusals::forged), HasSubstr("tether link show"));
  EXPECT_THAT(said_after(&Refusals::stranger), HasSubstr("unknown key"));
  EXPECT_THAT(said_after(nullptr), HasSubstr("nothing arrives"));
}

TEST(Diagnosis, SaysEachThingOnce) {
  Diagnosis diagnosis("vehicle7");
  const Diagnosis::Sight both{{"wifi", "5g"}, {}, {}, 0.0};
  EXPECT_EQ(diagnosis.look(kStart, both), "peer \"vehicle7\": up, by wifi and 5g");
  EXPECT_FALSE(diagnosis.look(kStart + seconds{1}, both));
  const Diagnosis::Sight one{{"5g"}, {"wifi"}, {}, 0.0};
  EXPECT_EQ(diagnosis.look(kStart + seconds{2}, one), "peer \"vehicle7\": up, by 5g; wifi is down");
}

TEST(Diagnosis, RepeatedClockTroubleIsOneLine) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight{{}, {"wifi"}, {}, 73.2};
  diagnosis.look(kStart, sight);
  ++sight.refused.clock;
  EXPECT_TRUE(diagnosis.look(kStart + seconds{5}, sight));
  sight.clock_ahead_s = 74.0;
  EXPECT_FALSE(diagnosis.look(kStart + seconds{6}, sight));
}

}  // namespace
}  // namespace tether::link
