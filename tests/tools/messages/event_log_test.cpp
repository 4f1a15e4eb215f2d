#include "tools/messages/event_log.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <sstream>
#include <string>
#include <vector>

namespace tether {
namespace {

struct Event {
  std::int64_t number;
  std::int64_t timestamp_us;
  std::string channel;
  std::string data;
  bool operator==(const Event&) const = default;
};

struct Contents {
  bool looks_like_log = false;
  std::vector<Event> events;
  std::vector<LogDamage> damage;
  std::uint64_t size_bytes = 0;
};

Contents read_all(const std::string& bytes) {
  std::istringstream stream(bytes);
  EventLogReader reader(stream);
  Contents contents;
  contents.looks_like_log = reader.looks_like_log();
  for (LoggedEvent event; reader.next(event);) {
    contents.events.push_back({event.event_number, event.timestamp_us, event.channel,
                               std::string(event.data.begin(), event.data.end())});
  }
  contents.damage = reader.damage();
  contents.size_bytes = reader.offset_bytes();
  return contents;
}

std::string big_endian(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

std::string record(const Event& e) {
  return big_endian(EventLogReader::kMagic, 4) +
         big_endian(static_cast<std::uint64_t>(e.number), 8) +
         big_endian(static_cast<std::uint64_t>(e.timestamp_us), 8) +
         big_endian(e.channel.size(), 4) + big_endian(e.data.size(), 4) + e.channel + e.data;
}

const Event kFirst{0, 1'000'000, "AGV/POSE", "twelve bytes"};
const Event kSecond{1, 1'050'000, "CTRL/CMD_VEL", ""};
const Event kThird{2, -5, "SIM/CLOCK", std::string("\xed\xa1\xda\x00 nul inside", 15)};

/// kFirst, kSecond, kThird as LCM itself writes them.
std::string genuine_log() {
  char path[] = "/tmp/event_log_test.XXXXXX";
  close(mkstemp(path));
  {
    lcm::LogFile log(path, "w");
    for (const Event& e : {kFirst, kSecond, kThird}) {
      lcm::LogEvent event{};
      event.timestamp = e.timestamp_us;
      event.channel = e.channel;
      event.datalen = static_cast<int>(e.data.size());
      event.data = const_cast<char*>(e.data.data());
      EXPECT_EQ(log.writeEvent(&event), 0);
    }
  }
  std::ifstream file(path, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(file), {}};
  std::remove(path);
  return bytes;
}

TEST(EventLog, ReadsWhatLcmWrites) {
  const std::string log = genuine_log();
  EXPECT_EQ(log, record(kFirst) + record(kSecond) + record(kThird));
  const Contents contents = read_all(log);
  EXPECT_TRUE(contents.looks_like_log);
  EXPECT_EQ(contents.events, (std::vector{kFirst, kSecond, kThird}));
  EXPECT_TRUE(contents.damage.empty());
  EXPECT_EQ(contents.size_bytes, log.size());
}

TEST(EventLog, AnEmptyFileIsALogWithoutEvents) {
  const Contents contents = read_all("");
  EXPECT_TRUE(contents.looks_like_log);
  EXPECT_TRUE(contents.events.empty());
  EXPECT_TRUE(contents.damage.empty());
}

TEST(EventLog, OtherFilesDoNotLookLikeLogs) {
  for (const char* text : {"[run]\nduration_s = 62.0\n", "x", "\xed\xa1\xda\x02", "\xed\xa1\xdb"}) {
    EXPECT_FALSE(read_all(text).looks_like_log) << text;
  }
}

TEST(EventLog, TruncatedAnywhereKeepsEveryWholeRecordAndSaysWhatIsLost) {
  const std::string log = genuine_log();
  const std::vector<Event> all = {kFirst, kSecond, kThird};
  std::vector<std::size_t> ends = {0};
  for (const Event& e : all) ends.push_back(ends.back() + record(e).size());

  for (std::size_t size = 0; size <= log.size(); ++size) {
    SCOPED_TRACE(size);
    const Contents contents = read_all(log.substr(0, size));
    std::size_t whole = 0;
    while (whole < all.size() && ends[whole + 1] <= size) ++whole;
    EXPECT_TRUE(contents.looks_like_log);
    EXPECT_EQ(contents.events,
              std::vector<Event>(all.begin(), all.begin() + std::ptrdiff_t(whole)));
    EXPECT_EQ(contents.size_bytes, size);
    if (size == ends[whole]) {
      EXPECT_TRUE(contents.damage.empty());
      continue;
    }
    ASSERT_EQ(contents.damage.size(), 1U);
    EXPECT_TRUE(contents.damage[0].truncated_tail);
    EXPECT_EQ(contents.damage[0].offset_bytes, ends[whole]);
    EXPECT_EQ(contents.damage[0].size_bytes, size - ends[whole]);
  }
}

TEST(EventLog, SkipsARecordWithACorruptLengthAndGoesOn) {
  const std::size_t second = record(kFirst).size();
  for (const std::size_t field : {20U, 24U}) {  // channel length, data length
    for (const std::uint32_t length :
         {0xffffffffU, 0x80000000U, 0x7fffffffU, 1'000'000U, 1001U, 1U}) {
      SCOPED_TRACE(testing::Message() << field << " " << length);
      std::string log = record(kFirst) + record(kSecond) + record(kThird);
      log.replace(second + field, 4, big_endian(length, 4));
      const Contents contents = read_all(log);
      EXPECT_EQ(contents.events, (std::vector{kFirst, kThird}));
      ASSERT_EQ(contents.damage.size(), 1U);
      EXPECT_FALSE(contents.damage[0].truncated_tail);
      EXPECT_EQ(contents.damage[0].offset_bytes, second);
      EXPECT_EQ(contents.damage[0].size_bytes, record(kSecond).size());
    }
  }
}

TEST(EventLog, AChannelWithoutANameIsDamage) {
  const Contents contents = read_all(record(kFirst) + record({1, 0, "", "x"}) + record(kThird));
  EXPECT_EQ(contents.events, (std::vector{kFirst, kThird}));
  EXPECT_EQ(contents.damage.size(), 1U);
}

TEST(EventLog, GoesOnAfterATailThatBrokeOffAndWasAppendedTo) {
  const std::string cut = record(kFirst).substr(0, 33);
  const Contents contents = read_all(record(kThird) + cut + record(kSecond) + record(kFirst));
  EXPECT_EQ(contents.events, (std::vector{kThird, kSecond, kFirst}));
  ASSERT_EQ(contents.damage.size(), 1U);
  EXPECT_EQ(contents.damage[0].offset_bytes, record(kThird).size());
  EXPECT_EQ(contents.damage[0].size_bytes, cut.size());
}

TEST(EventLog, EveryFlippedByteCostsAtMostTwoRecords) {
  const std::string log = record(kFirst) + record(kSecond) + record(kThird) + record(kFirst);
  for (std::size_t i = 0; i < log.size(); ++i) {
    std::string broken = log;
    broken[i] = static_cast<char>(~broken[i]);
    const Contents contents = read_all(broken);
    EXPECT_GE(contents.events.size(), 2U) << i;  // a broken magic also spoils the record before it
    EXPECT_EQ(contents.size_bytes, log.size());
  }
}

TEST(EventLog, ReportsZerosAfterAPowerCutAsDamageNotAsTruncation) {
  const std::string log = record(kFirst) + record(kSecond);
  const Contents contents = read_all(log + std::string(4096, '\0'));
  EXPECT_EQ(contents.events, std::vector{kFirst});
  ASSERT_EQ(contents.damage.size(), 1U);
  EXPECT_FALSE(contents.damage[0].truncated_tail);
  EXPECT_EQ(contents.damage[0].size_bytes, record(kSecond).size() + 4096);
}

TEST(EventLog, ReadsRecordsLargerThanItsBuffer) {
  std::string log;
  std::vector<Event> events;
  for (int i = 0; i < 20; ++i) {
    events.push_back({i, i, "BIG", std::string(std::size_t(1) << i, static_cast<char>('a' + i))});
    log += record(events.back());
  }
  const Contents contents = read_all(log);
  EXPECT_EQ(contents.events, events);
  EXPECT_TRUE(contents.damage.empty());
}

}  // namespace
}  // namespace tether
