#include "common/base/time.hpp"

#include <gtest/gtest.h>

#include <cstdint>

namespace tether {
namespace {

using namespace std::chrono_literals;

TEST(Time, SecondsBecomeTheNearestNanosecond) {
  EXPECT_EQ(from_seconds(0.1), 100ms);
  EXPECT_EQ(from_seconds(-0.1), -100ms);
  EXPECT_EQ(from_seconds(1.4e-9), 1ns);
  EXPECT_EQ(from_seconds(1.6e-9), 2ns);
  EXPECT_EQ(from_seconds(86'400.0), 24h);
}

TEST(Time, NanosecondsBecomeSecondsAndMilliseconds) {
  EXPECT_DOUBLE_EQ(to_seconds(1'500ms), 1.5);
  EXPECT_DOUBLE_EQ(to_seconds(kStart - 250ms), -0.25);
  EXPECT_DOUBLE_EQ(to_milliseconds(1'500us), 1.5);
}

TEST(Time, AStampIsRoundedDownAlsoBeforeTheStart) {
  EXPECT_EQ(to_utime(kStart + 1'999ns), 1);
  EXPECT_EQ(to_utime(kStart), 0);
  EXPECT_EQ(to_utime(kStart - 1ns), -1);
  EXPECT_EQ(to_utime(kStart - 1'000ns), -1);
  EXPECT_EQ(to_utime(kStart - 1'001ns), -2);
}

TEST(Time, AStampSurvivesTheRoundTrip) {
  for (const std::int64_t utime : {0L, 1L, -1L, 62'000'000L, -5'000'000L, 3'153'600'000'000'000L}) {
    EXPECT_EQ(to_utime(from_utime(utime)), utime);
  }
}

TEST(Time, AnImpossibleStampSaturatesSoThatDifferencesCannotOverflow) {
  const Instant latest = from_utime(INT64_MAX);
  const Instant earliest = from_utime(INT64_MIN);
  const Duration century = 24h * 36'500;
  EXPECT_GT(latest - kStart, century);
  EXPECT_LT(earliest - kStart, -century);
  EXPECT_EQ(latest, from_utime(INT64_MAX - 1));
  EXPECT_GT(latest - earliest, 2 * century);
  EXPECT_GT(latest + century, latest);
}

}  // namespace
}  // namespace tether
