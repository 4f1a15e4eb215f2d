#include "tools/view/server/playback.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "tools/view/server/log_player.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

Instant played_at(double t_s) { return kStart + from_seconds(t_s); }

TEST(ViewPlayback, StandsAtTheStartUntilItIsPlayed) {
  const Playback playback(played_at(-2), played_at(10));
  EXPECT_EQ(playback.position(played_at(100)), played_at(-2));
  EXPECT_FALSE(playback.playing(played_at(100)));
}

TEST(ViewPlayback, GoesOnFromWhereItIsWhateverIsChanged) {
  Playback playback(played_at(0), played_at(100));
  playback.play(played_at(1000));
  EXPECT_EQ(playback.position(played_at(1004)), played_at(4));
  playback.set_speed(played_at(1004), 10.0);
  EXPECT_EQ(playback.position(played_at(1005)), played_at(14));
  playback.pause(played_at(1005));
  EXPECT_EQ(playback.position(played_at(2000)), played_at(14));
  playback.set_speed(played_at(2000), 0.1);
  playback.seek(played_at(2000), played_at(50));
  EXPECT_EQ(playback.position(played_at(2100)), played_at(50));
  playback.play(played_at(2100));
  EXPECT_EQ(playback.position(played_at(2110)), played_at(51));
}

TEST(ViewPlayback, EndsAtTheEndAndThenBeginsAgain) {
  Playback playback(played_at(0), played_at(10));
  playback.play(played_at(0));
  EXPECT_TRUE(playback.playing(played_at(9.9)));
  EXPECT_EQ(playback.position(played_at(1e6)), played_at(10));
  EXPECT_FALSE(playback.playing(played_at(11)));
  playback.play(played_at(20));
  EXPECT_EQ(playback.position(played_at(21)), played_at(1));
}

TEST(ViewPlayback, JumpsStayWithin) {
  Playback playback(played_at(0), played_at(10));
  playback.seek(played_at(0), played_at(-5));
  EXPECT_EQ(playback.position(played_at(0)), played_at(0));
  playback.seek(played_at(0), played_at(50));
  EXPECT_EQ(playback.position(played_at(0)), played_at(10));
}

std::string big_endian_bytes(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

/// An event of an LCM log.
std::string played_event(double t_s, const std::string& channel, const std::string& data) {
  return big_endian_bytes(EventLogReader::kMagic, 4) + big_endian_bytes(0, 8) +
         big_endian_bytes(static_cast<std::uint64_t>(to_utime(played_at(t_s))), 8) +
         big_endian_bytes(channel.size(), 4) + big_endian_bytes(data.size(), 4) + channel + data;
}

LogIndex index_of(const std::string& log, std::size_t most = LogIndex::kMostEntries) {
  std::istringstream stream(log);
  EventLogReader reader(stream);
  return {reader, "run.lcmlog", most};
}

const std::string kLog = played_event(0, "A", "a0") + played_event(1, "B", "b1") +
                         played_event(2, "A", "a2") + played_event(3, "A", "a3") +
                         played_event(4, "B", "b4");

TEST(ViewLogIndex, KnowsWhereEachMessageIs) {
  const LogIndex index = index_of(kLog);
  ASSERT_THAT(index.entries(), SizeIs(5));
  for (const auto& entry : index.entries()) {
    const std::string data = kLog.substr(entry.offset_bytes, entry.size_bytes);
    EXPECT_EQ(data.substr(0, 1), index.channel(entry) == "A" ? "a" : "b");
    EXPECT_EQ(played_at(data[1] - '0'), entry.time);
  }
  EXPECT_EQ(index.count_until(played_at(-1)), 0);
  EXPECT_EQ(index.count_until(played_at(2)), 3);
  EXPECT_EQ(index.count_until(played_at(9)), 5);
  EXPECT_THAT(index.latest(0, 3), ElementsAre(1, 2));
  EXPECT_THAT(index.latest(2, 4), ElementsAre(3));
}

TEST(ViewLogIndex, PutsEventsInTheOrderOfTheirTime) {
  const LogIndex index = index_of(played_event(2, "A", "a2") + played_event(1, "A", "a1") +
                                  played_event(2, "B", "b2"));
  std::vector<std::string> channels;
  for (const auto& entry : index.entries()) channels.push_back(index.channel(entry));
  EXPECT_EQ(index.entries().front().time, played_at(1));
  EXPECT_THAT(channels, ElementsAre("A", "A", "B"));
}

TEST(ViewLogIndex, RefusesALogThatIsTooLong) {
  EXPECT_THROW(index_of(kLog, 4), UsageError);
  EXPECT_NO_THROW(index_of(kLog, 5));
}

TEST(ViewLogPlayer, ShowsEachMessageOnceWhenItIsDue) {
  const LogIndex index = index_of(kLog);
  LogPlayer player(index);
  player.play(played_at(100));
  EXPECT_THAT(player.due(played_at(100)), ElementsAre(0));
  EXPECT_THAT(player.due(played_at(100.5)), IsEmpty());
  EXPECT_THAT(player.due(played_at(102.5)), ElementsAre(1, 2));
  EXPECT_THAT(player.due(played_at(110)), ElementsAre(3, 4));
  EXPECT_THAT(player.due(played_at(120)), IsEmpty());
}

TEST(ViewLogPlayer, AJumpShowsTheLatestOfEachChannelBefore) {
  const LogIndex index = index_of(kLog);
  LogPlayer player(index);
  player.due(played_at(0));
  player.seek(played_at(0), played_at(3.5));
  EXPECT_THAT(player.due(played_at(0)), ElementsAre(1, 3));
  player.seek(played_at(0), played_at(0.5));  // back, while it stands
  EXPECT_THAT(player.due(played_at(1)), ElementsAre(0));
  EXPECT_THAT(player.due(played_at(2)), IsEmpty());
}

TEST(ViewLogPlayer, BeginsAgainWithTheStateOfTheStart) {
  const LogIndex index = index_of(kLog);
  LogPlayer player(index);
  player.play(played_at(0));
  player.due(played_at(50));
  player.play(played_at(60));
  EXPECT_THAT(player.due(played_at(60)), ElementsAre(0));
  EXPECT_THAT(player.due(played_at(61)), ElementsAre(1));
}

TEST(ViewLogPlayer, PlayedVeryFastShowsOnlyTheLatestOfEachChannel) {
  std::string log;
  for (int i = 0; i < 3000; ++i) log += played_event(0.001 * i, i % 2 == 0 ? "A" : "B", "x");
  const LogIndex index = index_of(log);
  LogPlayer player(index);
  player.play(played_at(0));
  player.due(played_at(0));
  EXPECT_THAT(player.due(played_at(0.5)), SizeIs(500));
  EXPECT_THAT(player.due(played_at(2.5)), ElementsAre(2499, 2500));
}

}  // namespace
}  // namespace tether
