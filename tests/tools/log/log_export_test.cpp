#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>
#include <string>
#include <tether/all_messages.hpp>
#include <vector>

#include "tests/support/folder.hpp"
#include "tools/log/csv_export.hpp"
#include "tools/log/log_survey.hpp"
#include "tools/log/mcap_export.hpp"

namespace tether {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

std::string big_endian(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = size - 1; i >= 0; --i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

std::string record(std::int64_t time_us, const std::string& channel, const std::string& data) {
  return big_endian(EventLogReader::kMagic, 4) + big_endian(0, 8) +
         big_endian(static_cast<std::uint64_t>(time_us), 8) + big_endian(channel.size(), 4) +
         big_endian(data.size(), 4) + channel + data;
}

template <class LcmType>
std::string bytes_of(const LcmType& message) {
  std::string bytes(static_cast<std::size_t>(message.getEncodedSize()), '\0');
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::string pose(std::int64_t time_us, std::int64_t seq, const std::string& channel = "AGV/POSE") {
  pose_t message{};
  message.utime = time_us;
  message.seq = seq;
  message.x_m = 0.5;
  return record(time_us, channel, bytes_of(message));
}

struct Exported {
  McapExportReport report;
  std::string bytes;
};

Exported exported(const std::string& log, bool ros2 = false) {
  std::istringstream first(log), second(log);
  EventLogReader survey_reader(first), reader(second);
  const LogSurvey survey = survey_log(survey_reader);
  Exported made;
  made.report = export_mcap(reader, survey, {ros2, {}, "test"},
                            [&](std::string_view bytes) { made.bytes += bytes; });
  return made;
}

TEST(McapExport, CountsWhatItTakesAndSaysWhatItLeavesOut) {
  const std::string log = pose(0, 0) + record(1, "LCM_SELF_TEST", "lcm self test") +
                          record(2, "AGV/POSE", bytes_of(pose_t{}).substr(0, 20)) + pose(3, 1) +
                          record(4, "EMPTY", "");
  const McapExportReport report = exported(log).report;
  EXPECT_EQ(report.events, 5);
  EXPECT_EQ(report.converted, 2);
  EXPECT_EQ(report.messages, 2U + 1U + 2U);  // with the scene and two transforms
  EXPECT_THAT(report.left_out.lines(),
              ElementsAre("1 message on AGV/POSE: a pose_t that cannot be decoded",
                          "1 message on EMPTY: of an unknown type (-)",
                          HasSubstr("1 message on LCM_SELF_TEST: of an unknown type (0x")));
}

TEST(McapExport, TakesALogThatBreaksOffUpToThere) {
  const std::string log = pose(0, 0) + pose(1, 1) + pose(2, 2).substr(0, 50);
  const McapExportReport report = exported(log).report;
  EXPECT_EQ(report.converted, 2);
  ASSERT_EQ(report.damage.size(), 1U);
  EXPECT_TRUE(report.damage[0].truncated_tail);
}

TEST(McapExport, OfTheSameLogGivesTheSameBytes) {
  std::string log;
  for (int i = 0; i < 200; ++i) log += pose(i, i) + pose(i, i, "CTRL/POSE");
  EXPECT_EQ(exported(log).bytes, exported(log).bytes);
  EXPECT_EQ(exported(log, true).bytes, exported(log, true).bytes);
}

TEST(McapExport, MovesTimesBelowZeroUpByWholeSeconds) {
  EXPECT_EQ(exported(pose(0, 0)).report.shift_us, 0);
  EXPECT_EQ(exported(pose(-1, 0)).report.shift_us, 1'000'000);
  EXPECT_EQ(exported(pose(5, 1) + pose(-1'000'000, 0)).report.shift_us, 1'000'000);
  EXPECT_EQ(exported(pose(-1'000'001, 0)).report.shift_us, 2'000'000);
}

TEST(McapExport, SurvivesTimesThatNoLogHas) {
  for (const std::int64_t time_us : {INT64_MAX, INT64_MIN, INT64_MIN + 1}) {
    for (const bool ros2 : {false, true}) {
      EXPECT_EQ(exported(pose(time_us, 0) + pose(0, 1), ros2).report.events, 2) << time_us;
    }
  }
}

TEST(McapExport, AsABagLeavesOutWhatRosHasNoMessagesFor) {
  const std::string log = pose(0, 0) + record(1, "NET/COUNTERS", bytes_of(counters_t{}));
  const McapExportReport report = exported(log, true).report;
  EXPECT_EQ(report.converted, 1);
  EXPECT_EQ(report.messages, 2U);  // with /tf
  EXPECT_THAT(
      report.left_out.lines(),
      ElementsAre("1 message on NET/COUNTERS: counters_t, which has no counterpart in ROS 2"));
}

TEST(McapExport, EndsAtABoundOfInventedChannels) {
  std::string log;
  for (int i = 0; i < 1200; ++i) {
    log += record(i, "X" + std::to_string(i), bytes_of(counters_t{}));
  }
  const McapExportReport report = exported(log).report;
  EXPECT_EQ(report.converted, 1000);
  EXPECT_EQ(report.left_out.count(), 200);
  EXPECT_EQ(report.left_out.lines().size(), 21U);
}

TEST(LogSurvey, KnowsChannelsWithSomethingToDecodeAndTheEarliestTime) {
  std::istringstream stream(pose(7, 0) + pose(3, 1, "CTRL/POSE") + record(9, "X", "nothing"));
  EventLogReader reader(stream);
  const LogSurvey survey = survey_log(reader);
  EXPECT_EQ(survey.events, 3);
  EXPECT_EQ(survey.earliest_us, 3);
  EXPECT_THAT(survey.channels, ElementsAre("AGV/POSE", "CTRL/POSE"));
}

TEST(CsvExport, WritesOneTableAChannel) {
  const test::Folder folder;
  std::istringstream stream(pose(1'500'000, 0) + pose(-1, 1, "a_POSE") + pose(3, 2, "a/POSE") +
                            record(4, "AGV/POSE", bytes_of(twist_t{})));
  EventLogReader reader(stream);
  const CsvExportReport report = csv_export_all(reader, folder.path);
  std::vector<std::string> files;
  for (const CsvFile& table : report.tables) files.push_back(table.channel + ": " + table.file);
  EXPECT_THAT(files,
              ElementsAre("AGV/POSE: AGV_POSE.csv", "a/POSE: a_POSE_2.csv", "a_POSE: a_POSE.csv"));
  EXPECT_THAT(report.left_out.lines(),
              ElementsAre("1 message on AGV/POSE: a twist_t among pose_t"));
  EXPECT_EQ(test::contents(folder.path / "AGV_POSE.csv"),
            "t_s,utime,seq,run,x_m,y_m,yaw_rad,plan_session,plan_id\n"
            "1.500000,1500000,0,0,0.5,0,0,0,0\n");
}

TEST(CsvExport, NamesOfFilesStayInTheFolder) {
  const test::Folder folder;
  std::istringstream stream(pose(0, 0, "../../x") + pose(0, 0, "..") +
                            pose(0, 0, std::string(900, 'y')));
  EventLogReader reader(stream);
  for (const CsvFile& table : csv_export_all(reader, folder.path).tables) {
    EXPECT_THAT(table.file, Not(HasSubstr("/")));
    EXPECT_TRUE(std::filesystem::is_regular_file(folder.path / table.file)) << table.file;
  }
}

}  // namespace
}  // namespace tether
