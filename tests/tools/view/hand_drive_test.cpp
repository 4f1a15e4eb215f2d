#include <gtest/gtest.h>

#include "common/base/errors.hpp"
#include "tools/view/sources/network_view.hpp"

namespace tether {
namespace {

using std::chrono::milliseconds;

constexpr const char* kForward = R"({"v_mps": 1.5, "omega_radps": -0.5})";

Instant at(std::int64_t ms) { return Instant{milliseconds{ms}}; }

clock_t clock_of(std::int64_t utime, std::int64_t run = 7, double rate = 1.0) {
  clock_t clock{};
  clock.utime = utime;
  clock.run = run;
  clock.rate = rate;
  return clock;
}

pose_t pose_of(std::int64_t utime, std::int64_t run = 7) {
  pose_t pose{};
  pose.utime = utime;
  pose.run = run;
  return pose;
}

TEST(HandDrive, TwistIsStampedAsAControllersOfThisRun) {
  HandDrive drive;
  drive.hear(clock_of(2'000'000, 7, 0.5), at(100));
  drive.hear(pose_of(1'900'000));
  drive.hear(pose_of(1'800'000));     // late
  drive.hear(pose_of(1'950'000, 8));  // pose of another run
  const twist_t twist = drive.take(1, kForward, at(140));
  EXPECT_EQ(twist.utime, 2'020'000);
  EXPECT_EQ(twist.run, 7);
  EXPECT_EQ(twist.pose_utime, 1'900'000);
  EXPECT_EQ(twist.v_mps, 1.5);
  EXPECT_EQ(twist.omega_radps, -0.5);
  EXPECT_EQ(drive.take(1, kForward, at(190)).seq, twist.seq + 1);
}

TEST(HandDrive, SilenceStopsTheVehicleThenNothingIsSent) {
  HandDrive drive;
  drive.hear(clock_of(0), at(0));
  EXPECT_FALSE(drive.tick(at(0)));
  drive.take(1, kForward, at(0));
  EXPECT_FALSE(drive.tick(at(250)));
  int zeros = 0;
  for (int ms = 300; ms < 3000; ms += 50) {
    const auto twist = drive.tick(at(ms));
    if (!twist) continue;
    EXPECT_EQ(twist->v_mps, 0.0);
    EXPECT_EQ(twist->omega_radps, 0.0);
    ++zeros;
  }
  EXPECT_EQ(zeros, 20);
}

TEST(HandDrive, OneDrivesUntilItLetsGo) {
  HandDrive drive;
  drive.hear(clock_of(0), at(0));
  drive.take(1, kForward, at(0));
  EXPECT_THROW(drive.take(2, kForward, at(100)), UsageError);
  EXPECT_NO_THROW(drive.take(2, kForward, at(300)));
  EXPECT_THROW(drive.take(1, kForward, at(350)), UsageError);
}

TEST(HandDrive, NothingIsDrivenWithoutARunsClock) {
  HandDrive drive;
  EXPECT_THROW(drive.take(1, kForward, at(0)), UsageError);
  drive.hear(clock_of(0), at(0));
  EXPECT_NO_THROW(drive.take(1, kForward, at(900)));
  EXPECT_THROW(drive.take(1, kForward, at(1100)), UsageError);
}

TEST(HandDrive, NonsenseIsRefused) {
  HandDrive drive;
  drive.hear(clock_of(0), at(0));
  for (const char* json :
       {"", "1", "{}", R"({"v_mps": 1})", R"({"v_mps": "1", "omega_radps": 0})",
        R"({"v_mps": 1e9, "omega_radps": 0})", R"({"v_mps": 1, "omega_radps": -6})",
        R"({"v_mps": null, "omega_radps": 0})"}) {
    EXPECT_THROW(drive.take(1, json, at(0)), UsageError) << json;
  }
  EXPECT_FALSE(drive.tick(at(1000)));
}

}  // namespace
}  // namespace tether
