#include "controller/laws/network_estimate.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "common/base/errors.hpp"
#include "common/base/random.hpp"
#include "controller/laws/tau_table.hpp"

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

TEST(ReceptionEstimate, AStreamThatStartsAnewIsJudgedAnew) {
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

TauTable table_of(const std::string& text) {
  std::istringstream in(text);
  return TauTable::read(in, "t.csv");
}

constexpr char kTable[] =
    "arm,channel.prr,channel.delay_ms,controller.tau_s,epsilon_m\n"
    "0,0.5,0,1.0,3.0\n0,0.5,0,2.0,5.0\n0,0.5,100,1.0,4.0\n0,0.5,100,2.0,3.0\n"
    "0,1.0,0,1.0,3.0\n0,1.0,0,3.0,2.0\n0,1.0,100,1.0,3.0\n0,1.0,100,4.0,1.0\n";

TEST(TauTable, HasTheLookAheadOfTheLeastErrorInEachCell) {
  const TauTable table = table_of(kTable);
  EXPECT_EQ(table.tau_s(0.5, 0.0), 1.0);
  EXPECT_EQ(table.tau_s(0.5, 100.0), 2.0);
  EXPECT_EQ(table.tau_s(1.0, 0.0), 3.0);
  EXPECT_EQ(table.tau_s(1.0, 100.0), 4.0);
}

TEST(TauTable, IsLinearInBetweenAndConstantOutside) {
  const TauTable table = table_of(kTable);
  EXPECT_DOUBLE_EQ(table.tau_s(0.75, 50.0), 2.5);
  EXPECT_DOUBLE_EQ(table.tau_s(0.1, 50.0), 1.5);
  EXPECT_DOUBLE_EQ(table.tau_s(1.0, 1e6), 4.0);
}

TEST(TauTable, AveragesTheRunsOfASweep) {
  const TauTable table =
      table_of("channel.prr,controller.tau_s,epsilon_m\n1,1,1\n1,1,9\n1,1,\n1,2,4\n1,2,4\n");
  EXPECT_EQ(table.tau_s(1.0, 0.0), 2.0);
}

TEST(TauTable, RefusesWhatIsNoTable) {
  const auto why = [](const std::string& text) -> std::string {
    try {
      table_of(text);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(why("a,b\n1,2\n").find("t.csv: has no column channel.prr"), std::string::npos);
  EXPECT_NE(why("channel.prr,controller.tau_s,epsilon_m\n").find("no look-ahead"),
            std::string::npos);
  EXPECT_NE(why("channel.prr,controller.tau_s,epsilon_m\n2,1,1\n").find("t.csv:2: "),
            std::string::npos);
  EXPECT_NE(why("channel.prr,channel.delay_ms,controller.tau_s,epsilon_m\n1,0,1,1\n0,5,1,1\n")
                .find("all combinations"),
            std::string::npos);
}

TEST(TauTable, TheOneThatComesWithTheProjectIsGood) {
  std::ifstream in(TETHER_SOURCE_DIR "/scenarios/tau_table.csv");
  const TauTable table = TauTable::read(in, "tau_table.csv");
  EXPECT_NEAR(table.tau_s(1.0, 0.0), 2.0, 0.01);
  EXPECT_LT(table.tau_s(1.0, 500.0), 2.0);
}

}  // namespace
}  // namespace tether
