#include <gtest/gtest.h>

#include "controller/laws/predictive_law.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

TEST(ClockEstimate, KnowsNothingBeforeItHasSeenBothWays) {
  ClockEstimate clock;
  EXPECT_EQ(clock.offset(), Duration{0});
  clock.add_up(milliseconds{80});
  EXPECT_EQ(clock.offset(), Duration{0});
}

TEST(ClockEstimate, IsHalfTheDifferenceOfEqualWays) {
  for (const int offset : {-50, 0, 20}) {
    ClockEstimate clock;
    clock.add_up(milliseconds{30 - offset});
    clock.add_down(milliseconds{30 + offset - 5}, milliseconds{30 + offset + 5});
    EXPECT_NEAR(to_milliseconds(clock.offset()), offset, 1.0);
  }
}

TEST(ClockEstimate, IsWrongByHalfOfWhatTheWaysDiffer) {
  ClockEstimate clock;
  clock.add_up(milliseconds{130});
  clock.add_down(milliseconds{29}, milliseconds{31});
  EXPECT_NEAR(to_milliseconds(clock.offset()), -50.0, 1.0);
}

TEST(ClockEstimate, SaysNothingWherePlansAreSeenTooLate) {
  ClockEstimate clock;
  clock.add_up(milliseconds{80});
  clock.add_down(milliseconds{-100}, milliseconds{900});
  EXPECT_EQ(clock.offset(), Duration{0});
}

TEST(ClockEstimate, IsNeverBeyondWhatDelaysAllow) {
  ClockEstimate clock;
  clock.add_up(milliseconds{-40});  // the vehicle is ahead by 40 ms at least
  clock.add_down(milliseconds{45}, milliseconds{95});
  EXPECT_GE(clock.offset(), milliseconds{40});
  EXPECT_LE(clock.offset(), milliseconds{95});
}

}  // namespace
}  // namespace tether
