#include <gmock/gmock.h>

#include "doors/link/node/link_node.hpp"

namespace tether::link {
namespace {

using std::chrono::seconds;
using ::testing::HasSubstr;

std::string text_of(const std::optional<Diagnosis::Line>& line) {
  return line ? line->text : "nothing";
}

/// Diagnosis 5 s after a peer was seen last, when `count` has gone up since.
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
  EXPECT_THAT(said_after(&Refusals::unknown_key), HasSubstr("its key is another now"));
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
  EXPECT_THAT(text_of(diagnosis.look(kStart + seconds{1}, sight)),
              HasSubstr("down: its paths are in another order"));
}

TEST(Diagnosis, TakesTheMessagesOfUnknownSendersOnlyForAHint) {
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
  EXPECT_THAT(text_of(diagnosis.look(kStart, sight)),
              HasSubstr("60000 ms apart at least, and messages for a time"));
  sight.clock_offset_s = -61.0;
  EXPECT_THAT(text_of(diagnosis.look(kStart + seconds{1}, sight)), HasSubstr("-61.0 s apart"));
  sight.clock_offset_s = -62.0;
  EXPECT_FALSE(diagnosis.look(kStart + seconds{2}, sight));
  sight.clock_offset_s = 0.0;
  EXPECT_EQ(text_of(diagnosis.look(kStart + seconds{3}, sight)), "peer \"vehicle7\": up, by wifi");
}

TEST(Diagnosis, SaysFromWhenOnClocksMatter) {
  Diagnosis diagnosis("vehicle7");
  Diagnosis::Sight sight = sight_of({"wifi"});
  int second = 0;
  const auto said = [&](double offset_s) {
    sight.clock_offset_s = offset_s;
    const auto line = diagnosis.look(kStart + seconds{++second}, sight);
    if (line && line->text.find("apart") != std::string::npos) {
      EXPECT_EQ(line->severity, Severity::warning);
    }
    return text_of(line);
  };
  EXPECT_EQ(said(0.049), "peer \"vehicle7\": up, by wifi");
  EXPECT_EQ(said(0.051),
            "peer \"vehicle7\": up, by wifi; the clocks are 51 ms apart at least: set both "
            "(chrony, NTP)");
  for (const double noise : {0.049, 0.055, 0.045}) EXPECT_EQ(said(noise), "nothing");
  EXPECT_THAT(said(-0.12), HasSubstr("120 ms apart"));
  EXPECT_THAT(said(-0.21), HasSubstr("210 ms apart at least, and messages for a time, such as "
                                     "plans, are refused"));
  EXPECT_EQ(said(-0.19), "nothing");
  EXPECT_THAT(said(-0.1), HasSubstr("100 ms apart at least: set"));
  EXPECT_EQ(said(0.0), "peer \"vehicle7\": up, by wifi");
}

TEST(Diagnosis, SaysAtOnceThatAPeerHasGone) {
  Diagnosis diagnosis("vehicle7");
  diagnosis.look(kStart, sight_of({"wifi"}));
  const auto line = diagnosis.look(kStart + seconds{1}, sight_of({}, {"wifi"}));
  EXPECT_THAT(text_of(line), HasSubstr("down: nothing arrives"));
  EXPECT_EQ(line->severity, Severity::warning);
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
