#include "tools/messages/rotating_log.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"
#include "tools/messages/event_log.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using Bytes = std::vector<std::uint8_t>;

struct RotatingLogTest : ::testing::Test {
  /// Files of 1000 bytes, of which 3 are kept; 5000 bytes stay free.
  RotatingLog open() {
    return RotatingLog({.folder = folder.path,
                        .file_bytes = 1000,
                        .files = 3,
                        .keep_free_bytes = 5000,
                        .free_bytes = [this](const fs::path&) { return disk - used(); }});
  }
  std::uint64_t used() const {
    std::uint64_t bytes = 0;
    for (const auto& entry : fs::directory_iterator(folder.path)) bytes += entry.file_size();
    return bytes;
  }
  std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder.path)) {
      names.push_back(entry.path().filename());
    }
    std::sort(names.begin(), names.end());
    return names;
  }
  /// Time stamps of the messages of a file.
  std::vector<std::int64_t> stamps(const std::string& name) const {
    std::ifstream in(folder.path / name, std::ios::binary);
    EventLogReader reader(in);
    std::vector<std::int64_t> all;
    for (LoggedEvent event; reader.next(event);) {
      EXPECT_EQ(event.channel, "AGV/POSE");
      EXPECT_EQ(event.data.size(), 500U);
      all.push_back(event.timestamp_us);
    }
    EXPECT_TRUE(reader.damage().empty());
    return all;
  }
  void write(RotatingLog& log, int messages) {
    for (int i = 0; i < messages; ++i) log.write("AGV/POSE", Bytes(500, 7), ++now);
  }

  test::Folder folder;
  std::uint64_t disk = 1'000'000;
  std::int64_t now = 0;
};

TEST_F(RotatingLogTest, KeepsTheNewestFilesOverAllStarts) {
  for (int start = 0; start < 2; ++start) {
    RotatingLog log = open();
    write(log, 5);
    log.flush();
  }
  EXPECT_THAT(files(), ElementsAre("floor-00000004.lcmlog", "floor-00000005.lcmlog",
                                   "floor-00000006.lcmlog"));
  EXPECT_THAT(stamps("floor-00000005.lcmlog"), ElementsAre(8, 9));
  EXPECT_THAT(stamps("floor-00000006.lcmlog"), ElementsAre(10));
}

TEST_F(RotatingLogTest, DeletesOldFilesWhereSpaceIsShortAndThenEndsTheNewest) {
  RotatingLog log = open();
  write(log, 5);
  log.flush();
  EXPECT_THAT(files(), ElementsAre("floor-00000001.lcmlog", "floor-00000002.lcmlog",
                                   "floor-00000003.lcmlog"));

  disk = 5000 + used() - 1;  // the oldest is enough
  log.flush();
  EXPECT_THAT(files(), ElementsAre("floor-00000002.lcmlog", "floor-00000003.lcmlog"));

  disk = 5000;  // others have taken it
  log.flush();
  EXPECT_THAT(files(), ElementsAre("floor-00000003.lcmlog"));
  const std::uint64_t before = used();
  write(log, 10);
  log.flush();
  EXPECT_EQ(used(), before);
  EXPECT_EQ(log.lost(), 10);
  EXPECT_EQ(log.written(), 5);

  disk = 1'000'000;
  log.flush();
  write(log, 1);
  log.flush();
  EXPECT_THAT(files(), ElementsAre("floor-00000003.lcmlog", "floor-00000004.lcmlog"));
  EXPECT_THAT(stamps("floor-00000004.lcmlog"), ElementsAre(16));
}

TEST_F(RotatingLogTest, LeavesOtherFilesAlone) {
  for (const char* name :
       {"estop.AGV.can0", "floor-a.lcmlog", "other-00000001.lcmlog", "floor-00000009.csv"}) {
    std::ofstream(folder.path / name) << "kept";
  }
  RotatingLog log = open();
  write(log, 20);
  EXPECT_THAT(files(), testing::IsSupersetOf({"estop.AGV.can0", "floor-a.lcmlog",
                                              "floor-00000009.csv", "other-00000001.lcmlog"}));
  EXPECT_EQ(files().size(), 7U);
}

TEST_F(RotatingLogTest, RefusesAFolderThatDoesNotExist) {
  EXPECT_THROW(RotatingLog({.folder = folder.path / "none"}), UsageError);
}

TEST_F(RotatingLogTest, NeverWritesWhatExists) {
  fs::create_symlink("/dev/full", folder.path / "floor-00000002.lcmlog");
  RotatingLog::Settings settings{.folder = folder.path, .keep_free_bytes = 0};
  RotatingLog log(settings);
  EXPECT_EQ(log.file().filename(), "floor-00000003.lcmlog");
  EXPECT_GT(RotatingLog::free_bytes_of(folder.path), 0U);
  EXPECT_EQ(RotatingLog::free_bytes_of(folder.path / "none"), 0U);
}

}  // namespace
}  // namespace tether
