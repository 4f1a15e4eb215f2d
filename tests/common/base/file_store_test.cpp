#include "common/base/file_store.hpp"

#include <gmock/gmock.h>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"

namespace tether {
namespace {

using std::chrono::hours;

struct FileStoreTest : ::testing::Test {
  /// A file that was last changed so many hours ago.
  std::string file(const std::string& name, const std::string& text, int hours_ago) {
    const auto path = folder.file(name, text);
    std::filesystem::last_write_time(
        path, std::filesystem::file_time_type::clock::now() - hours{hours_ago});
    return path;
  }

  test::Folder folder;
  int reads = 0;
  FileStore<std::string> store{[this](const std::string& name) {
    ++reads;
    if (!std::filesystem::exists(name)) throw UsageError("nothing there");
    return test::contents(name);
  }};
};

TEST_F(FileStoreTest, ReadsAFileThatStaysOnce) {
  const std::string name = file("a", "one", 2);
  EXPECT_EQ(*store.get(name), "one");
  EXPECT_EQ(*store.get(name), "one");
  EXPECT_EQ(reads, 1);
}

TEST_F(FileStoreTest, ReadsAFileThatChangedAgainAndLeavesTheOldContentToThoseWhoHaveIt) {
  const auto before = store.get(file("a", "one", 2));
  EXPECT_EQ(*store.get(file("a", "two", 1)), "two");
  EXPECT_EQ(*before, "one");
}

TEST_F(FileStoreTest, ReadsAgainWhatWasJustWritten) {
  const std::string name = folder.file("a", "one");
  store.get(name);
  folder.file("a", "two");
  EXPECT_EQ(*store.get(name), "two");
}

TEST_F(FileStoreTest, KeepsNothingOfWhatCannotBeRead) {
  const std::string name = folder.path / "a";
  EXPECT_THROW(store.get(name), UsageError);
  EXPECT_EQ(*store.get(file("a", "one", 2)), "one");
}

TEST_F(FileStoreTest, KeepsTheLatestFew) {
  const std::string first = file("0", "0", 2);
  store.get(first);
  for (int i = 1; i <= 4; ++i) store.get(file(std::to_string(i), "x", 2));
  EXPECT_EQ(reads, 5);
  store.get(first);
  EXPECT_EQ(reads, 6);
}

}  // namespace
}  // namespace tether
