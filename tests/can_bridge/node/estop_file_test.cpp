#include "can_bridge/node/estop_file.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "common/base/errors.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;

struct EstopFileTest : ::testing::Test {
  fs::path folder = fs::path(::testing::TempDir()) / "tether_estop_file_test";
  fs::path path = folder / "state" / "estop.AGV.can0";

  EstopFileTest() { fs::remove_all(folder); }
  ~EstopFileTest() override { fs::remove_all(folder); }
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
  fs::create_directories(folder);
  std::ofstream(folder / "state") << "a file where the folder should be";
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
