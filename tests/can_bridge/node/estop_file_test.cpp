#include "can_bridge/node/estop_file.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "common/base/errors.hpp"
#include "tests/support/folder.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct EstopFileTest : ::testing::Test {
  test::Folder folder;
  fs::path path = folder.path / "state" / "estop.AGV.can0";
};

TEST_F(EstopFileTest, ALatchOutlivesTheProgramUntilItIsReset) {
  {
    EstopFile file(path);
    EXPECT_FALSE(file.latched());
    file.remember(true);
  }
  EXPECT_TRUE(fs::exists(path));
  {
    EstopFile file(path);
    EXPECT_TRUE(file.latched());
    file.remember(false);
  }
  EXPECT_FALSE(EstopFile(path).latched());
  EXPECT_FALSE(fs::exists(path));
}

TEST_F(EstopFileTest, ABridgeThatCouldNotRememberDoesNotStart) {
  folder.file("state", "a file where the folder should be");
  EXPECT_THROW(EstopFile{path}, UsageError);
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
