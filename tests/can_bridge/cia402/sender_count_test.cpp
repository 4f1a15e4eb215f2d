#include <gtest/gtest.h>

#include <vector>

#include "can_bridge/cia402/axes.hpp"

namespace tether::cia402 {
namespace {

/// SYNC, then so many frames.
int surplus(SenderCount& count, const std::vector<int>& frames_after_each_sync) {
  int too_many = 0;
  for (const int frames : frames_after_each_sync) {
    count.on_sync();
    for (int i = 0; i < frames; ++i) too_many += count.on_frame() ? 0 : 1;
  }
  return too_many;
}

TEST(SenderCount, OneSourceIsNoneTooManyWhateverItsFramesAreLateBy) {
  SenderCount count(1);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(surplus(count, {1, 1, 0, 2, 0, 0, 3, 1, 0, 1, 2}), 0);
  }
  EXPECT_FALSE(count.two_sources());
}

TEST(SenderCount, ASecondSourceAtEachSyncIsReportedInTheThirdPeriod) {
  SenderCount count(1);
  surplus(count, {1, 1, 1, 2, 2});
  EXPECT_FALSE(count.two_sources());
  surplus(count, {2});
  EXPECT_TRUE(count.two_sources());
}

TEST(SenderCount, LostFramesDelayThatByThreePeriodsAtMost) {
  SenderCount count(1);
  surplus(count, std::vector<int>(100, 0));
  surplus(count, {2, 2, 2, 2});
  EXPECT_FALSE(count.two_sources());
  surplus(count, {2});
  EXPECT_TRUE(count.two_sources());
}

TEST(SenderCount, ARepeatedFrameNowAndThenIsNoSecondSource) {
  SenderCount count(1);
  for (int i = 0; i < 20; ++i) {
    surplus(count, {2});
    surplus(count, std::vector<int>(24, 1));
    EXPECT_FALSE(count.two_sources()) << i;
  }
}

TEST(SenderCount, ThreeFramesTooManyWithin50SyncsAreASecondSource) {
  for (const int apart : {24, 25}) {
    SenderCount count(1);
    for (int i = 0; i < 2; ++i) {
      surplus(count, {2});
      surplus(count, std::vector<int>(apart - 1, 1));
    }
    surplus(count, {2});
    EXPECT_EQ(count.two_sources(), apart == 24) << apart;
  }
}

TEST(SenderCount, ATpdoOfEveryThirdSyncIsCountedAgainstThose) {
  SenderCount count(3);
  EXPECT_EQ(surplus(count, {0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 1, 0}), 0);
  for (int i = 0; i < 5; ++i) surplus(count, {1, 0, 1});
  EXPECT_TRUE(count.two_sources());
}

TEST(SenderCount, RestartsAfterAReset) {
  SenderCount count(1);
  surplus(count, {2, 2, 2});
  ASSERT_TRUE(count.two_sources());
  count.reset();
  EXPECT_FALSE(count.two_sources());
  surplus(count, {2, 2});
  EXPECT_FALSE(count.two_sources());
}

}  // namespace
}  // namespace tether::cia402
