#include "link/node/diagnosis.hpp"

#include <gmock/gmock.h>

namespace tether::link {
namespace {

using std::chrono::seconds;
using ::testing::HasSubstr;

std::string text_of(const std::optional<Diagnosis::Line>& line) {
  return line ? line->text : "nothing";
}

/// What is said 5 s after a peer was seen last, when `count` has gone up since.
std::string said_after(std::int64_t Refusals::*count, double clock_ahead_s = 0.0) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight;
  sight.dead = {"wifi"};
  sight.clock_ahead_s = clock_ahead_s;
  EXPECT_FALSE(diagnosis.look(kStart, sight));
  if (count != nullptr) ++(sight.refused.*count);
  return text_of(diagnosis.look(kStart + seconds{5}, sight));
}

Diagnosis::Sight sight_of(std::vector<std::string> alive, std::vector<std::string> dead = {}) {
  Diagnosis::Sight sight;
  sight.alive = std::move(alive);
  sight.dead = std::move(dead);
  return sight;
}

TEST(Diagnosis, SaysWhyAPeerIsDownAndWhatToDo) {
  EXPECT_THAT(said_after(&Refusals::clock, 73.2), HasSubstr("+73.2 s apart"));
  EXPECT_THAT(said_after(&Refusals::version), HasSubstr("same Tether on both hosts"));
  EXPECT_THAT(said_after(&Refusals::address),
              HasSubstr("perhaps it sends from elsewhere than its `addresses`"));
  EXPECT_THAT(said_after(&Refusals::forged), HasSubstr("tether-link show"));
  EXPECT_THAT(said_after(&Refusals::stranger), HasSubstr("its key is another now"));
  EXPECT_THAT(said_after(nullptr), HasSubstr("nothing arrives"));
}

TEST(Diagnosis, SaysEachThingOnce) {
  Diagnosis diagnosis("vehicle7");
  const auto both = diagnosis.look(kStart, sight_of({"wifi", "5g"}));
  EXPECT_EQ(text_of(both), "peer \"vehicle7\": up, by wifi and 5g");
  EXPECT_EQ(both->severity, Severity::info);
  EXPECT_FALSE(diagnosis.look(kStart + seconds{1}, sight_of({"wifi", "5g"})));
  const auto one = diagnosis.look(kStart + seconds{2}, sight_of({"5g"}, {"wifi"}));
  EXPECT_EQ(text_of(one), "peer \"vehicle7\": up, by 5g; wifi is down");
  EXPECT_EQ(one->severity, Severity::warning);
}

TEST(Diagnosis, SaysThatPathsAreInAnotherOrderWhetherMessagesComeOrNot) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({"wifi", "5g"});
  sight.crossed = true;
  EXPECT_THAT(text_of(diagnosis.look(kStart, sight)),
              HasSubstr("up, by wifi and 5g; its paths are in another order"));
  std::swap(sight.alive, sight.dead);
  diagnosis.look(kStart, sight);
  EXPECT_THAT(text_of(diagnosis.look(kStart + seconds{5}, sight)), HasSubstr("another order"));
}

TEST(Diagnosis, TakesWhatStrangersSendMostForAHintAlone) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({}, {"wifi"});
  diagnosis.look(kStart, sight);
  sight.refused.address += 3;
  sight.refused.version += 2;
  EXPECT_THAT(text_of(diagnosis.look(kStart + seconds{5}, sight)),
              HasSubstr("nothing authentic arrives; perhaps it sends from elsewhere"));
}

TEST(Diagnosis, SaysWhichPathDropsLongPackets) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({"wifi", "5g"});
  sight.narrow = {"5g"};
  sight.mtu = 1400;
  EXPECT_THAT(text_of(diagnosis.look(kStart, sight)),
              HasSubstr("5g does not carry packets of 1400 bytes: set a smaller mtu"));
}

TEST(Diagnosis, SaysThatClocksAreApartWhileASessionLives) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({"wifi"});
  sight.clock_offset_s = -60.0;
  EXPECT_EQ(text_of(diagnosis.look(kStart, sight)), "peer \"vehicle7\": up, by wifi");
  sight.clock_offset_s = -61.0;
  EXPECT_THAT(text_of(diagnosis.look(kStart + seconds{1}, sight)), HasSubstr("-61.0 s apart"));
  sight.clock_offset_s = -62.0;
  EXPECT_FALSE(diagnosis.look(kStart + seconds{2}, sight));
  sight.clock_offset_s = 0.0;
  EXPECT_EQ(text_of(diagnosis.look(kStart + seconds{3}, sight)), "peer \"vehicle7\": up, by wifi");
}

TEST(Diagnosis, RepeatedClockTroubleIsOneLine) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({}, {"wifi"});
  sight.clock_ahead_s = 73.2;
  diagnosis.look(kStart, sight);
  ++sight.refused.clock;
  EXPECT_TRUE(diagnosis.look(kStart + seconds{5}, sight));
  sight.clock_ahead_s = 74.0;
  EXPECT_FALSE(diagnosis.look(kStart + seconds{6}, sight));
}

}  // namespace
}  // namespace tether::link
