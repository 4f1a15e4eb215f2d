#include <gtest/gtest.h>

#include <cmath>

#include "tools/nodes/dashboard.hpp"

namespace tether {
namespace {

link_report_t report(std::int64_t delivered, std::int64_t lost, double delay_ms_mean) {
  link_report_t report{};
  report.offered = delivered + lost;
  report.delivered = delivered;
  report.lost = lost;
  report.delay_ms_mean = delay_ms_mean;
  return report;
}

TEST(RecentLink, KnowsNothingBeforeAnythingWasSent) {
  RecentLink link;
  link.add(0.0, report(0, 0, 0.0), 0);
  link.add(0.5, report(0, 0, 0.0), 0);
  EXPECT_TRUE(std::isnan(link.seen().prr));
  EXPECT_TRUE(std::isnan(link.seen().delay_ms));
  EXPECT_EQ(link.seen().per_s, 0.0);
}

TEST(RecentLink, IsOfTheLastTenSecondsAlone) {
  RecentLink link;
  for (int t_s = 0; t_s <= 30; ++t_s)
    link.add(t_s, report(t_s, 0, 10.0), t_s);  // 10 ms, all arrive
  for (int s = 1; s <= 10; ++s) {              // then half is lost, and the rest takes 70 ms
    link.add(30 + s, report(30 + s, s, (30 * 10.0 + s * 70.0) / (30 + s)), 30 + s);
  }
  EXPECT_NEAR(link.seen().prr, 0.5, 1e-12);
  EXPECT_NEAR(link.seen().delay_ms, 70.0, 1e-9);
  EXPECT_NEAR(link.seen().per_s, 1.0, 1e-12);
}

TEST(RecentLink, WithAMessageASecondDoesNotFlicker) {
  RecentLink link;
  for (int half = 0; half <= 60; ++half) {
    const int sent = half / 2;  // and asked twice a second
    link.add(0.5 * half, report(sent, 0, 10.0), sent);
    if (half < 20) continue;
    EXPECT_NEAR(link.seen().per_s, 1.0, 0.051) << half;
  }
}

TEST(RecentLink, RestartsWithARelayThatRestarts) {
  RecentLink link;
  link.add(0.0, report(100, 100, 500.0), 100);
  link.add(1.0, report(0, 0, 0.0), 100);
  link.add(2.0, report(4, 0, 10.0), 104);
  EXPECT_EQ(link.seen().prr, 1.0);
  EXPECT_EQ(link.seen().delay_ms, 10.0);
}

TEST(TerminalStatus, WritesOverWhatStandsThereAndErasesOnlyTheRest) {
  EXPECT_EQ(TerminalStatus::rewritten(0, {"one"}), "\rone\033[J");
  EXPECT_EQ(TerminalStatus::rewritten(3, {"one", "two"}), "\r\033[2Aone\033[K\ntwo\033[J");
}

}  // namespace
}  // namespace tether
