#include <gtest/gtest.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <thread>

#include "tools/nodes/external_run.hpp"

namespace tether {
namespace {

using namespace std::chrono_literals;

/// Waits for all children, adopted ones, too; false: some live on.
bool all_children_end_within(std::chrono::seconds time) {
  const auto deadline = std::chrono::steady_clock::now() + time;
  while (std::chrono::steady_clock::now() < deadline) {
    const pid_t ended = waitpid(-1, nullptr, WNOHANG);
    if (ended < 0) return true;
    if (ended == 0) std::this_thread::sleep_for(1ms);
  }
  return false;
}

TEST(ExternalProgram, LeavesNothingBehindWhenItsOwnerIsKilledAtAnyMoment) {
  prctl(PR_SET_CHILD_SUBREAPER, 1);  // orphans become our children
  for (int i = 0; i < 300; ++i) {
    const pid_t owner = fork();
    if (owner == 0) {
      // Two processes: a shell, which dies with its owner, and its child, which does not.
      const ExternalProgram program("sleep 60; true", [](const std::string&) {});
      pause();
    }
    std::this_thread::sleep_for(i * 10us);
    kill(owner, SIGKILL);
  }
  EXPECT_TRUE(all_children_end_within(30s));
  prctl(PR_SET_CHILD_SUBREAPER, 0);
}

TEST(ExternalProgram, EndsWithItsOwner) {
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  {
    const ExternalProgram program("sleep 60 & sleep 60; true", [](const std::string&) {});
  }
  EXPECT_TRUE(all_children_end_within(30s));
  prctl(PR_SET_CHILD_SUBREAPER, 0);
}

}  // namespace
}  // namespace tether
