#include "controller/laws/network_estimate.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "common/base/random.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

TEST(ReceptionEstimate, CountsTheNumbersThatAreMissing) {
  ReceptionEstimate estimate(100);
  EXPECT_EQ(estimate.ratio(), 1.0);
  for (const std::int64_t seq : {10, 11, 13, 19}) estimate.add(seq);
  EXPECT_DOUBLE_EQ(estimate.ratio(), 4.0 / 10.0);
}

TEST(ReceptionEstimate, ForgetsWhatIsBehindItsWindow) {
  ReceptionEstimate estimate(10);
  estimate.add(0);
  for (std::int64_t seq = 50; seq < 60; ++seq) estimate.add(seq);
  EXPECT_DOUBLE_EQ(estimate.ratio(), 1.0);
}

TEST(ReceptionEstimate, ALongGapLeavesWhatTheWindowHolds) {
  ReceptionEstimate estimate(10);
  for (std::int64_t seq = 0; seq < 10; ++seq) estimate.add(seq);
  estimate.add(14);  // 5 to 14: 5 … 9 and 14
  EXPECT_DOUBLE_EQ(estimate.ratio(), 0.6);
}

TEST(ReceptionEstimate, AStreamThatRestartsIsJudgedAgain) {
  ReceptionEstimate estimate(100);
  estimate.add(5);
  estimate.add(50);
  estimate.add(0);
  EXPECT_EQ(estimate.ratio(), 1.0);
}

TEST(ReceptionEstimate, FindsTheRatioOfARandomStream) {
  RandomEngine random = random_stream(5, "reception");
  ReceptionEstimate estimate(4000);
  for (std::int64_t seq = 0; seq < 20000; ++seq) {
    if (uniform_01(random) < 0.45) estimate.add(seq);
  }
  // Four standard deviations of a share of 4000.
  EXPECT_NEAR(estimate.ratio(), 0.45, 4.0 * std::sqrt(0.45 * 0.55 / 4000.0));
}

TEST(DelayEstimate, IsTheLongestOfTheLast) {
  DelayEstimate estimate(3);
  EXPECT_EQ(estimate.longest(), Duration{0});
  for (const int ms : {500, 10, 30, 20}) estimate.add(milliseconds{ms});
  EXPECT_EQ(estimate.longest(), milliseconds{30});
  EXPECT_EQ(estimate.median(), milliseconds{20});
}

TEST(DelayEstimate, IsNeverNegativeWhateverTheClocksSay) {
  DelayEstimate estimate(3);
  estimate.add(milliseconds{-20});
  EXPECT_EQ(estimate.longest(), Duration{0});
}

}  // namespace
}  // namespace tether
