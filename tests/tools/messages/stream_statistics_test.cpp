#include "tools/messages/stream_statistics.hpp"

#include <gtest/gtest.h>

#include <tether/pose_t.hpp>

namespace tether {
namespace {

constexpr std::int64_t kPeriod_us = 50'000;

MessageStamp number(std::int64_t seq) { return {seq * kPeriod_us, seq}; }

SequenceCounter::Counters after(std::initializer_list<std::int64_t> numbers) {
  SequenceCounter counter;
  for (const std::int64_t seq : numbers) counter.on_message(number(seq));
  return counter.counters();
}

TEST(SequenceCounter, CountsNothingInAnUnbrokenStream) {
  const auto c = after({7, 8, 9, 10});
  EXPECT_EQ(c.missed + c.duplicated + c.reordered + c.restarts + c.invalid, 0);
}

TEST(SequenceCounter, CountsEverySkippedNumberAsMissed) {
  EXPECT_EQ(after({0, 1, 5}).missed, 3);
  EXPECT_EQ(after({0, 2, 4, 6}).missed, 3);
}

TEST(SequenceCounter, ALateNumberIsReorderedNotMissed) {
  const auto c = after({0, 1, 4, 2});
  EXPECT_EQ(c.missed, 1);
  EXPECT_EQ(c.reordered, 1);
  EXPECT_EQ(c.duplicated, 0);
}

TEST(SequenceCounter, EachPartOfAGapCanBeFilled) {
  const auto c = after({0, 9, 4, 1, 8, 4});
  EXPECT_EQ(c.missed, 8 - 3);
  EXPECT_EQ(c.reordered, 3);
  EXPECT_EQ(c.duplicated, 1);  // the second 4
}

TEST(SequenceCounter, ARepeatedNumberIsDuplicated) {
  EXPECT_EQ(after({0, 1, 1, 2, 0}).duplicated, 2);
  EXPECT_EQ(after({3, 3, 3}).duplicated, 2);
}

TEST(SequenceCounter, OneFromBeforeTheFirstIsReordered) {
  const auto c = after({10, 9, 11});
  EXPECT_EQ(c.reordered, 1);
  EXPECT_EQ(c.missed, 0);
}

TEST(SequenceCounter, LowerNumberWithLaterStampIsARestart) {
  SequenceCounter counter;
  for (int i = 0; i < 10; ++i) counter.on_message(number(i));
  counter.on_message({10 * kPeriod_us, 0});
  counter.on_message({11 * kPeriod_us, 1});
  EXPECT_EQ(counter.counters().restarts, 1);
  EXPECT_EQ(counter.counters().duplicated, 0);
  EXPECT_EQ(counter.counters().missed, 0);
}

TEST(SequenceCounter, AnotherRunFromTheBeginningIsARestartIfItLeadsBackByMoreThan5s) {
  EXPECT_EQ(after({101, 0}).restarts, 1);  // 5.05 s
  EXPECT_EQ(after({100, 0}).restarts, 0);  // 5.00 s: could still be a late message
  EXPECT_EQ(after({100, 0}).reordered, 1);
  EXPECT_EQ(after({101, 0, 1, 2, 4}).missed, 1);
}

TEST(SequenceCounter, AJumpByMoreThanAMillionIsARestart) {
  EXPECT_EQ(after({0, 1'000'001}).missed, 1'000'000);
  EXPECT_EQ(after({0, 1'000'002}).restarts, 1);
}

TEST(SequenceCounter, SurvivesNonsense) {
  SequenceCounter counter;
  for (const std::int64_t x :
       {INT64_MAX, INT64_MIN, std::int64_t{-1}, std::int64_t{0}, INT64_MAX}) {
    for (const std::int64_t y : {INT64_MAX, INT64_MIN, std::int64_t{-1}, std::int64_t{0}}) {
      counter.on_message({x, y});
    }
  }
  EXPECT_EQ(counter.counters().invalid, 10);
}

TEST(SequenceCounter, ForgetsTheOldestOfVeryManyGapsButNotTheirLoss) {
  SequenceCounter counter;
  for (std::int64_t i = 0; i <= 10'000; ++i) counter.on_message({0, 2 * i});
  EXPECT_EQ(counter.counters().missed, 10'000);
  counter.on_message({0, 1});  // gap forgotten
  counter.on_message({0, 19'999});
  EXPECT_EQ(counter.counters().missed, 9'999);
  EXPECT_EQ(counter.counters().duplicated, 1);
}

TEST(NearestRank, IsTheSmallestElementThatCoversTheQuantile) {
  const std::vector<double> tenths = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10};
  EXPECT_EQ(nearest_rank(tenths, 0.0), 1);
  EXPECT_EQ(nearest_rank(tenths, 0.1), 1);
  EXPECT_EQ(nearest_rank(tenths, 0.5), 5);
  EXPECT_EQ(nearest_rank(tenths, 0.9), 9);
  EXPECT_EQ(nearest_rank(tenths, 0.91), 10);
  EXPECT_EQ(nearest_rank(tenths, 1.0), 10);
  EXPECT_EQ(nearest_rank({4.0}, 0.5), 4.0);
}

StreamStatistics::Summary with_arrivals(const std::vector<std::int64_t>& arrivals_us) {
  StreamStatistics statistics;
  for (const std::int64_t us : arrivals_us) statistics.on_message(us, 100, std::nullopt);
  return statistics.summary();
}

TEST(StreamStatistics, IsAllZeroWithoutMessagesAndHasNoRateWithOne) {
  EXPECT_EQ(with_arrivals({}).count, 0);
  EXPECT_EQ(with_arrivals({}).rate_hz, 0.0);
  const auto one = with_arrivals({123});
  EXPECT_EQ(one.count, 1);
  EXPECT_EQ(one.bytes, 100);
  EXPECT_EQ(one.rate_hz, 0.0);
  EXPECT_EQ(one.jitter.max_ms, 0.0);
}

TEST(StreamStatistics, RateCountsIntervalsNotMessages) {
  const auto s = with_arrivals({1'000'000, 1'050'000, 1'100'000, 1'150'000, 1'200'000});
  EXPECT_DOUBLE_EQ(s.rate_hz, 20.0);
  EXPECT_DOUBLE_EQ(s.bandwidth_Bps, 2000.0);
  EXPECT_DOUBLE_EQ(s.median_interval_ms, 50.0);
  EXPECT_EQ(s.jitter.max_ms, 0.0);
}

TEST(StreamStatistics, OneLateMessageShowsInTheMaximumAndNotInTheMedian) {
  std::vector<std::int64_t> arrivals;
  for (int i = 0; i <= 100; ++i) arrivals.push_back(i * kPeriod_us + (i == 50 ? 10'000 : 0));
  const auto s = with_arrivals(arrivals);  // intervals: 98 × 50 ms, 60 ms, 40 ms
  EXPECT_DOUBLE_EQ(s.median_interval_ms, 50.0);
  EXPECT_DOUBLE_EQ(s.jitter.p50_ms, 0.0);
  EXPECT_DOUBLE_EQ(s.jitter.p90_ms, 0.0);
  EXPECT_DOUBLE_EQ(s.jitter.p99_ms, 10.0);
  EXPECT_DOUBLE_EQ(s.jitter.max_ms, 10.0);
}

TEST(StreamStatistics, SurvivesAClockThatGoesBackAndExtremeTimes) {
  EXPECT_EQ(with_arrivals({1'000'000, 0}).rate_hz, 0.0);
  EXPECT_EQ(with_arrivals({5, 5, 5}).rate_hz, 0.0);
  EXPECT_GE(with_arrivals({INT64_MIN, INT64_MAX, 0}).jitter.max_ms, 0.0);
}

TEST(StreamStatistics, KeepsTheNewestIntervals) {
  StreamStatistics statistics;
  std::int64_t now_us = 0;
  statistics.on_message(now_us, 1, std::nullopt);
  for (const std::int64_t interval : {10'000, 20'000}) {
    for (std::size_t i = 0; i < StreamStatistics::kMaxIntervals; ++i) {
      statistics.on_message(now_us += interval, 1, std::nullopt);
    }
  }
  EXPECT_DOUBLE_EQ(statistics.summary().median_interval_ms, 20.0);
  EXPECT_EQ(statistics.summary().jitter.max_ms, 0.0);
}

std::vector<std::uint8_t> pose_bytes(std::int64_t seq) {
  pose_t pose{};
  pose.utime = seq * kPeriod_us;
  pose.seq = seq;
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(pose.getEncodedSize()));
  pose.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

TEST(ChannelTable, ShowsTypeRateAndLossPerChannel) {
  ChannelTable table;
  for (const std::int64_t seq : {0, 1, 3, 4}) {
    table.on_message("CTRL/POSE", seq * kPeriod_us, inspect_message(pose_bytes(seq)));
  }
  EXPECT_EQ(table.channels(), std::vector<std::string>{"CTRL/POSE"});
  const std::string text = table.format();
  EXPECT_NE(text.find("CTRL/POSE  pose_t         4     15.00       1      0      0"),
            std::string::npos)
      << text;
}

TEST(ChannelTable, CountsUndecodableMessagesAndChangesOfType) {
  ChannelTable table;
  std::vector<std::uint8_t> broken = pose_bytes(0);
  broken.pop_back();
  table.on_message("X", 0, inspect_message(pose_bytes(0)));
  table.on_message("X", 1, inspect_message(broken));
  table.on_message("X", 2, inspect_message({}));
  EXPECT_EQ(table.undecodable(), 1);
  EXPECT_NE(table.format().find("X: 1 undecodable\nX: 1 changes of type\n"), std::string::npos)
      << table.format();
}

TEST(ChannelTable, BoundsTheNumberOfChannels) {
  ChannelTable table;
  for (std::size_t i = 0; i < ChannelTable::kMaxChannels + 5; ++i) {
    table.on_message("C" + std::to_string(i), 0, inspect_message({}));
  }
  EXPECT_EQ(table.channels().size(), ChannelTable::kMaxChannels);
  EXPECT_NE(table.format().find("5 messages of channels beyond the first 1000 are not listed"),
            std::string::npos);
}

}  // namespace
}  // namespace tether
