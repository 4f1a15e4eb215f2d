#include "common/world/scan.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "common/node/message_io.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;

constexpr std::int64_t kRun = 7;
constexpr double kStep_m = 0.001;

/// 270° in 20 ms; beam i sees 1 m and i mm.
Scan scan_of(std::size_t beams, Instant stamp = at_ms(100), std::int64_t seq = 3) {
  Scan scan;
  scan.stamp = stamp;
  scan.seq = seq;
  scan.mount = {0.4, -0.1, 0.2};
  scan.angle_min_rad = -2.25;
  scan.angle_increment_rad = 4.5 / static_cast<double>(beams);
  scan.time_increment_s = 0.02 / static_cast<double>(beams);
  scan.range_min_m = 0.05;
  scan.range_max_m = 20.0;
  scan.plan = {11, 12};
  for (std::size_t i = 0; i < beams; ++i) {
    scan.range_m.push_back(static_cast<float>(kStep_m * static_cast<double>(1000 + i)));
  }
  return scan;
}

std::vector<scan_part_t> three_parts(const Scan& scan) {
  scan_part_t empty{};
  const auto bytes = static_cast<std::size_t>(empty.getEncodedSize());
  auto parts = scan_parts(scan, kRun, 0, bytes + 2 * ((scan.range_m.size() + 2) / 3), kStep_m);
  EXPECT_EQ(parts.size(), 3U);
  return parts;
}

void expect_same(const Scan& a, const Scan& b) {
  EXPECT_EQ(a.stamp, b.stamp);
  EXPECT_EQ(a.seq, b.seq);
  EXPECT_EQ(a.mount.x_m, b.mount.x_m);
  EXPECT_EQ(a.mount.y_m, b.mount.y_m);
  EXPECT_EQ(a.mount.yaw_rad, b.mount.yaw_rad);
  EXPECT_EQ(a.angle_min_rad, b.angle_min_rad);
  EXPECT_EQ(a.angle_increment_rad, b.angle_increment_rad);
  EXPECT_EQ(a.time_increment_s, b.time_increment_s);
  EXPECT_EQ(a.range_min_m, b.range_min_m);
  EXPECT_EQ(a.range_max_m, b.range_max_m);
  EXPECT_EQ(a.plan, b.plan);
  EXPECT_EQ(a.range_m, b.range_m);
}

// ---------------------------------------------------------------------------- messages

TEST(ScanMessage, SaysAllThatAScanHas) {
  const Scan scan = scan_of(541);
  const scan_t message = scan_message(scan, kRun);
  EXPECT_EQ(message.run, kRun);
  const auto back = to_scan(message);
  ASSERT_TRUE(back);
  expect_same(*back, scan);
}

TEST(ScanMessage, OfTheMostBeamsFitsThroughTheBus) {
  const scan_t message = scan_message(scan_of(scan_t::MAX_COUNT), kRun);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  scan_t back{};
  ASSERT_TRUE(decode(bytes, back));
  EXPECT_TRUE(to_scan(back));
}

TEST(ScanMessage, ThatIsNotUsableIsRefused) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto spoil) {
    scan_t message = scan_message(scan_of(5), kRun);
    spoil(message);
    return !to_scan(message);
  };
  EXPECT_FALSE(refused([](scan_t&) {}));
  EXPECT_TRUE(refused([](scan_t& m) { m.count = 0, m.range_m.clear(); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.count = 4; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.count = 8193, m.range_m.resize(8193, 1.0F); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.range_m[2] = -1.0F; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.range_m[2] = std::numeric_limits<float>::infinity(); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.range_m[2] = std::numeric_limits<float>::quiet_NaN(); }));
  EXPECT_TRUE(refused([](scan_t& m) { m.angle_increment_rad = 0.0; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.angle_increment_rad = kNaN; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.angle_min_rad = kNaN; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.time_increment_s = -1e-6; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.time_increment_s = 1e9; })) << "no clock could tell";
  EXPECT_TRUE(refused([](scan_t& m) { m.mount_yaw_rad = kNaN; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.range_min_m = -0.1; }));
  EXPECT_TRUE(refused([](scan_t& m) { m.range_max_m = 0.01; })) << "below range_min_m";
}

// ---------------------------------------------------------------------------- parts

TEST(ScanParts, AreNoLargerThanAllowedAndHaveAllBeams) {
  for (const std::size_t beams : {1U, 2U, 541U, 1081U, 1651U, 8192U}) {
    for (const std::size_t max_bytes : {200U, 576U, 1400U, 65'000U}) {
      const auto parts = scan_parts(scan_of(beams), kRun, 40, max_bytes, kStep_m);
      std::size_t next = 0;
      for (std::size_t k = 0; k < parts.size(); ++k) {
        EXPECT_LE(parts[k].getEncodedSize(), static_cast<int>(max_bytes));
        EXPECT_EQ(parts[k].seq, 40 + static_cast<std::int64_t>(k));
        EXPECT_EQ(parts[k].scan, 3);
        EXPECT_EQ(parts[k].first, static_cast<std::int32_t>(next));
        next += parts[k].range.size();
      }
      EXPECT_EQ(next, beams);
      const auto most = std::max_element(parts.begin(), parts.end(),
                                         [](auto& a, auto& b) { return a.count < b.count; });
      EXPECT_GE(parts.back().count, most->count - 1) << "no small rest";
    }
  }
}

TEST(ScanParts, HaveABeamEachWhereNothingFits) {
  EXPECT_EQ(scan_parts(scan_of(5), kRun, 0, 1, kStep_m).size(), 5U);
}

TEST(ScanParts, RoundToStepsAndNeverToNothing) {
  Scan scan = scan_of(4);
  scan.range_m = {0.0F, 1e-6F, 1.00149F, 32.768F};
  const auto parts = scan_parts(scan, kRun, 0, 1400, kStep_m);
  ASSERT_EQ(parts.size(), 1U);
  EXPECT_EQ(parts[0].range, (std::vector<std::int16_t>{0, 1, 1001, 0})) << "too far: nothing";
}

// ---------------------------------------------------------------------------- assembly

struct Assembled : ::testing::Test {
  ScanAssembly assembly{std::chrono::milliseconds{30}};
  const Scan scan = scan_of(10);
  const std::vector<scan_part_t> parts = three_parts(scan);
};

TEST_F(Assembled, FromAllPartsInAnyOrderIsTheWholeScan) {
  std::vector<std::size_t> order{0, 1, 2};
  do {
    ScanAssembly fresh(std::chrono::milliseconds{30});
    EXPECT_FALSE(fresh.add(parts[order[0]]));
    EXPECT_FALSE(fresh.add(parts[order[1]]));
    const auto whole = fresh.add(parts[order[2]]);
    ASSERT_TRUE(whole);
    expect_same(*whole, scan);
    EXPECT_EQ(fresh.complete(), 1);
    EXPECT_EQ(fresh.incomplete(), 0);
    EXPECT_FALSE(fresh.deadline());
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST_F(Assembled, WithoutOnePartItIsReadyAfterThePatience) {
  for (std::size_t lost = 0; lost < parts.size(); ++lost) {
    ScanAssembly fresh(std::chrono::milliseconds{30});
    for (std::size_t k = 0; k < parts.size(); ++k) {
      EXPECT_FALSE(k != lost && fresh.add(parts[k]));
    }
    const Instant due = scan.end() + std::chrono::milliseconds{30};
    EXPECT_EQ(fresh.deadline(), due);
    EXPECT_FALSE(fresh.overdue(due - Duration{1}));
    const auto rest = fresh.overdue(due);
    ASSERT_TRUE(rest);
    EXPECT_EQ(fresh.incomplete(), 1);
    ASSERT_EQ(rest->range_m.size(), 10U) << "the beams' angles stay theirs";
    const auto first = static_cast<std::size_t>(parts[lost].first);
    for (std::size_t i = 0; i < 10; ++i) {
      const bool missing = i >= first && i < first + parts[lost].range.size();
      EXPECT_EQ(rest->range_m[i], missing ? 0.0F : scan.range_m[i]);
    }
    EXPECT_FALSE(fresh.add(parts[lost]));
    EXPECT_EQ(fresh.late_parts(), 1);
    EXPECT_FALSE(fresh.deadline());
  }
}

TEST_F(Assembled, APartOfALaterScanEndsTheWaiting) {
  const auto next = three_parts(scan_of(10, at_ms(200), 4));
  assembly.add(parts[0]);
  assembly.add(parts[2]);
  const auto rest = assembly.add(next[1]);
  ASSERT_TRUE(rest);
  EXPECT_EQ(rest->seq, 3);
  EXPECT_FALSE(assembly.add(parts[1])) << "too late";
  EXPECT_EQ(assembly.late_parts(), 1);
  assembly.add(next[0]);
  ASSERT_TRUE(assembly.add(next[2]));
  EXPECT_EQ(assembly.complete(), 1);
  EXPECT_EQ(assembly.incomplete(), 1);
}

TEST_F(Assembled, ALaterScanThatIsWholeByOnePartIsReadyAtOnce) {
  const auto next = scan_parts(scan_of(10, at_ms(200), 4), kRun, 3, 1400, kStep_m);
  ASSERT_EQ(next.size(), 1U);
  assembly.add(parts[0]);
  EXPECT_EQ(assembly.add(next[0]).value().seq, 3);
  EXPECT_LE(assembly.deadline(), at_ms(200));
  EXPECT_EQ(assembly.overdue(at_ms(221)).value().seq, 4);
  EXPECT_EQ(assembly.complete(), 1);
}

TEST_F(Assembled, EarlierScansThanTheOneInWorkAreLate) {
  assembly.add(three_parts(scan_of(10, at_ms(200), 4))[0]);
  EXPECT_FALSE(assembly.add(parts[0]));
  EXPECT_EQ(assembly.late_parts(), 1);
  EXPECT_EQ(assembly.deadline(), at_ms(200 + 18 + 30));
}

TEST_F(Assembled, DuplicatesChangeNothing) {
  assembly.add(parts[0]);
  EXPECT_FALSE(assembly.add(parts[0]));
  EXPECT_EQ(assembly.duplicated_parts(), 1);
  assembly.add(parts[1]);
  expect_same(assembly.add(parts[2]).value(), scan);
  EXPECT_FALSE(assembly.add(parts[2]));
  EXPECT_EQ(assembly.late_parts(), 1) << "of a scan that was ready";
}

TEST_F(Assembled, PartsThatOverlapFillWhatIsMissing) {
  scan_part_t wide = parts[1];
  wide.first = 0;
  wide.count = 10;
  wide.range.assign(10, 500);
  assembly.add(parts[0]);
  const Scan whole = assembly.add(wide).value();
  EXPECT_EQ(whole.range_m[0], scan.range_m[0]) << "who came first counts";
  EXPECT_EQ(whole.range_m[9], 0.5F);
}

TEST_F(Assembled, APublisherThatRestartedIsHeard) {
  for (const auto& part : parts) assembly.add(part);
  const auto restarted = three_parts(scan_of(10, at_ms(300), 0));
  assembly.add(restarted[0]);
  assembly.add(restarted[1]);
  EXPECT_EQ(assembly.add(restarted[2]).value().seq, 0);
}

TEST_F(Assembled, WhatIsNoPartOfTheScanIsCountedAndLeftOut) {
  assembly.add(parts[0]);
  std::int64_t bad = 0;
  const auto refuse = [&](auto spoil) {
    scan_part_t part = parts[1];
    spoil(part);
    EXPECT_FALSE(assembly.add(part));
    EXPECT_EQ(assembly.unusable_parts(), ++bad);
  };
  refuse([](scan_part_t& p) { p.count = 0, p.range.clear(); });
  refuse([](scan_part_t& p) { p.count += 1; });
  refuse([](scan_part_t& p) { p.first = -1; });
  refuse([](scan_part_t& p) { p.first = 8; });
  refuse([](scan_part_t& p) { p.first = std::numeric_limits<std::int32_t>::max(); });
  refuse([](scan_part_t& p) { p.beams = 0; });
  refuse([](scan_part_t& p) { p.beams = 11; });
  refuse([](scan_part_t& p) { p.beams = 8193; });
  refuse([](scan_part_t& p) { p.scan = -1; });
  refuse([](scan_part_t& p) { p.scan = 4; });
  refuse([](scan_part_t& p) { p.range_step_m = 0.0; });
  refuse([](scan_part_t& p) { p.range_step_m = std::numeric_limits<double>::infinity(); });
  refuse([](scan_part_t& p) { p.range[0] = -1; });
  refuse([](scan_part_t& p) { p.angle_increment_rad = 0.0; });
  refuse([](scan_part_t& p) { p.angle_min_rad += 0.1; });
  refuse([](scan_part_t& p) { p.mount_x_m += 1.0; });
  refuse([](scan_part_t& p) { p.time_increment_s *= 2.0; });
  refuse([](scan_part_t& p) { p.range_max_m += 1.0; });
  refuse([](scan_part_t& p) { p.plan_id += 1; });
  assembly.add(parts[1]);
  expect_same(assembly.add(parts[2]).value(), scan);
}

}  // namespace
}  // namespace tether
