#include "can_bridge/node/estop_file.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"
#include "tests/support/refusal.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Instant after_ms(int ms) { return kStart + std::chrono::milliseconds{ms}; }

/// Until it ends, no write to a file succeeds.
class NoWrites {
 public:
  NoWrites() {
    std::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit none{0, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &none);
  }
  ~NoWrites() { ::setrlimit(RLIMIT_FSIZE, &before_); }
  NoWrites(const NoWrites&) = delete;
  NoWrites& operator=(const NoWrites&) = delete;

 private:
  rlimit before_{};
};

struct EstopFileTest : ::testing::Test {
  test::Folder folder;
  fs::path path = folder.path / "state" / "estop.AGV.can0";

  /// A bridge whose e-stop was released, and that ended in good order.
  void run_once() {
    EstopFile file(path);
    file.remember(false, after_ms(0));
    file.end();
  }
  std::string refusal() {
    return refusal_of([this] { const EstopFile file(path); });
  }
};

TEST_F(EstopFileTest, AFileThatDidNotExistStartsLatched) {
  const EstopFile file(path);
  EXPECT_TRUE(file.latched());
  EXPECT_THAT(file.why(), HasSubstr("did not exist"));
}

TEST_F(EstopFileTest, HasItsWholeSizeBeforeTheBridgeRuns) {
  const EstopFile file(path);
  EXPECT_EQ(fs::file_size(path), 512U);
}

TEST_F(EstopFileTest, ACleanEndStartsUnlatched) {
  run_once();
  EXPECT_FALSE(EstopFile(path).latched());
}

TEST_F(EstopFileTest, AnEndWithoutProofStartsLatchedThoughNothingWasPressed) {
  {
    EstopFile file(path);
    file.remember(false, after_ms(0));
  }
  const EstopFile file(path);
  EXPECT_TRUE(file.latched());
  EXPECT_THAT(file.why(), HasSubstr("has no proof of a clean end"));
}

TEST_F(EstopFileTest, ALatchOutlivesACleanEndUntilItIsReset) {
  {
    EstopFile file(path);
    file.remember(false, after_ms(0));
    file.remember(true, after_ms(20));
    file.end();
  }
  {
    EstopFile file(path);
    EXPECT_EQ(file.why(), "it was latched when the bridge ended");
    file.remember(false, after_ms(0));
    file.end();
  }
  EXPECT_FALSE(EstopFile(path).latched());
}

TEST_F(EstopFileTest, ALatchThatCannotBeWrittenIsReportedAtOnceAndLatchedAtTheNextStart) {
  {
    EstopFile file(path);
    file.remember(false, after_ms(0));
    EXPECT_THAT(file.trouble(), IsEmpty());
    const NoWrites full;
    file.remember(true, after_ms(20));
    EXPECT_THAT(file.trouble(), HasSubstr("cannot be written: File too large"));
    file.end();
  }
  EXPECT_TRUE(EstopFile(path).latched());
}

TEST_F(EstopFileTest, AWriteThatFailedIsRepeatedOnceASecond) {
  EstopFile file(path);
  file.remember(false, after_ms(0));
  {
    const NoWrites full;
    file.remember(true, after_ms(20));
  }
  file.remember(true, after_ms(1019));
  EXPECT_THAT(file.trouble(), HasSubstr("cannot be written"));
  file.remember(true, after_ms(1020));
  EXPECT_THAT(file.trouble(), IsEmpty());
  EXPECT_EQ(EstopFile(path).why(), "it was latched when the bridge ended");
}

TEST_F(EstopFileTest, ADeletedFileIsReportedAtOnceAndNotTrustedAgain) {
  {
    EstopFile file(path);
    file.remember(false, after_ms(0));
    fs::remove(path);
    file.remember(false, after_ms(20));
    EXPECT_THAT(file.trouble(), HasSubstr("was deleted: find out why, then restart the bridge"));
    file.remember(true, after_ms(5000));
    EXPECT_THAT(file.trouble(), HasSubstr("was deleted"));
    file.end();
  }
  EXPECT_FALSE(fs::exists(path));
  EXPECT_TRUE(EstopFile(path).latched());
}

TEST_F(EstopFileTest, AFileThatWasAwayForACycleIsNotTrustedThoughItIsBack) {
  EstopFile file(path);
  file.remember(false, after_ms(0));
  fs::rename(path, folder.path / "away");
  file.remember(false, after_ms(20));
  fs::rename(folder.path / "away", path);
  file.remember(false, after_ms(40));
  EXPECT_THAT(file.trouble(), HasSubstr("was deleted"));
}

TEST_F(EstopFileTest, AFileThatSaysEndedInPlaceOfTheBridgesIsNotTrusted) {
  run_once();
  fs::copy(path, folder.path / "ended");
  EstopFile file(path);
  ASSERT_FALSE(file.latched());
  file.remember(false, after_ms(0));
  fs::rename(folder.path / "ended", path);
  file.remember(false, after_ms(20));
  EXPECT_THAT(file.trouble(), HasSubstr("was replaced"));
}

TEST_F(EstopFileTest, AFileThatAnotherProgramWritesIsNotTrusted) {
  EstopFile file(path);
  file.remember(false, after_ms(0));
  folder.file("state/estop.AGV.can0", "");
  file.remember(false, after_ms(20));
  EXPECT_THAT(file.trouble(), HasSubstr("was changed by another program"));
}

TEST_F(EstopFileTest, ACleanEndThatAnotherProgramWroteIsNoneOfThisBridge) {
  run_once();
  const std::string ended = test::contents(path);
  for (const bool replaced : {false, true}) {
    EstopFile file(path);
    file.remember(false, after_ms(0));
    if (replaced) fs::remove(path);
    folder.file("state/estop.AGV.can0", ended);
    file.remember(false, after_ms(20));
    // It is killed. Another bridge ends in good order.
    EstopFile other(path);
    EXPECT_EQ(other.why(), "it was latched when the bridge ended");
    other.remember(false, after_ms(20));
    other.end();
    file.remember(false, after_ms(1000));
    EXPECT_EQ(test::contents(path), ended) << "no more than once a second";
    file.remember(false, after_ms(1020));
    EXPECT_TRUE(EstopFile(path).latched()) << replaced;
    folder.file("state/estop.AGV.can0", ended);
    file.end();
    EXPECT_TRUE(EstopFile(path).latched()) << replaced;
    run_once();
  }
}

TEST_F(EstopFileTest, WhatTakesThePlaceOfTheFileIsNotOpenedUnlessItIsOne) {
  EstopFile file(path);
  fs::remove(path);
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  file.remember(true, after_ms(20));
  fs::remove(path);
  const fs::path elsewhere = folder.file("elsewhere", "kept");
  fs::create_symlink(elsewhere, path);
  file.remember(true, after_ms(1020));
  EXPECT_EQ(test::contents(elsewhere), "kept");
}

TEST_F(EstopFileTest, AnythingButAnIntactRecordStartsLatched) {
  run_once();
  const std::string ended = test::contents(path);
  for (const std::string& text : {std::string(), std::string("ended"), ended + "\n",
                                  ended.substr(0, 511), std::string(512, '\0')}) {
    folder.file("state/estop.AGV.can0", text);
    const EstopFile file(path);
    EXPECT_TRUE(file.latched());
    EXPECT_THAT(file.why(), HasSubstr("is no intact record"));
    EXPECT_EQ(fs::file_size(path), 512U);
  }
}

TEST_F(EstopFileTest, OnlyARegularFileIsOpened) {
  fs::create_directories(path.parent_path());
  ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0);
  EXPECT_THAT(refusal(), HasSubstr("it is a FIFO. Name a writable regular file by can.estop_file"));
  fs::remove(path);
  fs::create_directory(path);
  EXPECT_THAT(refusal(), HasSubstr("it is a directory"));
  fs::remove(path);
  fs::create_symlink("/dev/null", path);
  EXPECT_THAT(refusal(), HasSubstr("it is a symbolic link"));
  path = "/dev/null";
  EXPECT_THAT(refusal(), HasSubstr("it is a device"));
}

TEST_F(EstopFileTest, ABridgeThatCouldNotRememberDoesNotStart) {
  folder.file("state", "a file where the folder should be");
  EXPECT_THROW(EstopFile{path}, UsageError);
  fs::remove(folder.path / "state");
  run_once();
  const NoWrites full;
  EXPECT_THAT(refusal(), HasSubstr("File too large"));
}

TEST_F(EstopFileTest, ByDefaultItIsInTheStateFolderOfTheService) {
  ::setenv("STATE_DIRECTORY", "/var/lib/tether:/var/lib/other", 1);
  EXPECT_EQ(default_estop_file("AGV2", "can0"), "/var/lib/tether/estop.AGV2.can0");
  ::unsetenv("STATE_DIRECTORY");
  ::setenv("XDG_STATE_HOME", "/home/agv/state", 1);
  EXPECT_EQ(default_estop_file("AGV", "can1"), "/home/agv/state/tether/estop.AGV.can1");
  ::unsetenv("XDG_STATE_HOME");
}

}  // namespace
}  // namespace tether
