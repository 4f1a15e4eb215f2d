#include "doors/link/clock_offset.hpp"

#include <gtest/gtest.h>

#include <random>

namespace tether::link {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kDay_ns = 86'400 * 1000 * kMs;

Instant at_ns(std::int64_t ns) { return kStart + Duration{ns}; }

/// Two clocks, of which the peer's is ahead; and datagrams between them.
struct TwoClocks {
  std::int64_t ahead_ns;
  ClockOffset offset{};

  void hear(std::int64_t arrival_ns, std::int64_t delay_ns) {
    offset.on_heard(at_ns(arrival_ns), kDay_ns + arrival_ns - delay_ns + ahead_ns,
                    kDay_ns + arrival_ns);
  }
  void echo(std::int64_t sent_ns, std::int64_t delay_ns) {
    offset.on_echo(at_ns(sent_ns), kDay_ns + sent_ns, kDay_ns + sent_ns + delay_ns + ahead_ns);
  }
  IntervalNs known(std::int64_t now_ns) const { return offset.at(at_ns(now_ns)).value(); }
};

TEST(ClockOffset, IsUnknownUntilDatagramsWentBothWays) {
  TwoClocks clocks{7 * kMs};
  EXPECT_FALSE(clocks.offset.at(kStart));
  clocks.hear(0, kMs);
  EXPECT_FALSE(clocks.offset.at(kStart));
  clocks.echo(0, kMs);
  EXPECT_TRUE(clocks.offset.at(kStart));
}

TEST(ClockOffset, IsAnIntervalAsWideAsTheRoundTrip) {
  TwoClocks clocks{-40 * kMs};
  clocks.echo(0, 3 * kMs);
  clocks.hear(0, 5 * kMs);
  const IntervalNs known = clocks.known(0);
  EXPECT_EQ(known.min_ns, -45 * kMs);
  EXPECT_EQ(known.max_ns, -37 * kMs);
}

TEST(ClockOffset, TakesTheFastestDatagramOfEachDirection) {
  TwoClocks clocks{0};
  for (const std::int64_t delay : {9, 2, 8}) clocks.echo(0, delay * kMs);
  for (const std::int64_t delay : {7, 6, 4}) clocks.hear(0, delay * kMs);
  EXPECT_EQ(clocks.known(0).min_ns, -4 * kMs);
  EXPECT_EQ(clocks.known(0).max_ns, 2 * kMs);
}

TEST(ClockOffset, HoldsTheTruthWhateverTheDelaysAndTheDrift) {
  std::mt19937_64 random(1);
  for (const double ppm : {-100.0, 0.0, 100.0}) {
    TwoClocks clocks{3 * kMs};
    for (std::int64_t t = 0; t < 120'000 * kMs; t += 50 * kMs) {
      clocks.ahead_ns = 3 * kMs + static_cast<std::int64_t>(ppm * 1e-6 * static_cast<double>(t));
      const auto delay = [&] { return kMs + static_cast<std::int64_t>(random() % (80 * kMs)); };
      if (random() % 3 == 0) clocks.echo(t, delay());
      if (random() % 2 == 0) clocks.hear(t, delay());
      if (t < 1000 * kMs) continue;
      const IntervalNs known = clocks.known(t);
      ASSERT_LE(known.min_ns, clocks.ahead_ns) << "at " << t << " with " << ppm << " ppm";
      ASSERT_GE(known.max_ns, clocks.ahead_ns) << "at " << t << " with " << ppm << " ppm";
    }
    EXPECT_EQ(clocks.offset.steps(), 0);
  }
}

TEST(ClockOffset, ForgetsWhatIsOld) {
  TwoClocks clocks{0};
  clocks.echo(0, kMs);
  clocks.hear(0, kMs);
  const std::int64_t later = 40'000 * kMs;
  clocks.echo(later, 20 * kMs);
  clocks.hear(later, 20 * kMs);
  EXPECT_EQ(clocks.known(later).max_ns, 20 * kMs);
}

TEST(ClockOffset, NoticesAClockThatWasSet) {
  TwoClocks clocks{0};
  clocks.echo(0, kMs);
  clocks.hear(0, kMs);
  clocks.ahead_ns = 500 * kMs;
  clocks.hear(100 * kMs, kMs);
  clocks.echo(100 * kMs, kMs);
  EXPECT_EQ(clocks.offset.steps(), 1);
  EXPECT_EQ(clocks.known(100 * kMs).min_ns, 499 * kMs);
  EXPECT_EQ(clocks.known(100 * kMs).max_ns, 501 * kMs);
}

TEST(ClockOffset, SurvivesAnyTimesThatAPeerSays) {
  ClockOffset offset;
  for (const std::int64_t t :
       {INT64_MIN, std::int64_t{-1}, std::int64_t{0}, INT64_MAX / 2, INT64_MAX}) {
    offset.on_heard(kStart, t, kDay_ns);
    offset.on_echo(kStart, t, kDay_ns);
    offset.on_echo(kStart, kDay_ns, t);
  }
  SUCCEED();
}

}  // namespace
}  // namespace tether::link
