#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "common/base/errors.hpp"
#include "controller/laws/pid_law.hpp"
#include "tests/support/source_dir.hpp"

namespace tether {
namespace {

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
  std::ifstream in(in_source("/scenarios/tau_table.csv"));
  const TauTable table = TauTable::read(in, "tau_table.csv");
  EXPECT_NEAR(table.tau_s(1.0, 0.0), 2.0, 0.01);
  EXPECT_LT(table.tau_s(1.0, 500.0), 2.0);
}

}  // namespace
}  // namespace tether
