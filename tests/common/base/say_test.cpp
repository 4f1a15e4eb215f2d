#include "common/base/say.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace tether {
namespace {

TEST(Say, LosesALineThatAFullDiskRefusesAndThrowsNothing) {
  const int saved = dup(STDERR_FILENO);
  const int full = open("/dev/full", O_WRONLY);
  ASSERT_GE(full, 0);
  dup2(full, STDERR_FILENO);
  EXPECT_NO_THROW(say(Severity::warning, "the drives are switched off"));
  dup2(saved, STDERR_FILENO);
  close(full);
  close(saved);
}

}  // namespace
}  // namespace tether
