#include "onboard/localiser/localiser_node.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <tether/counters_t.hpp>
#include <tether/localisation_t.hpp>
#include <tether/pose_t.hpp>

#include "common/base/errors.hpp"
#include "common/scenario/scenario.hpp"
#include "common/vehicle/odometry_message.hpp"
#include "tests/localiser/hall.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::HallScanner;
using test::Seen;
using test::VirtualWorld;
using ::testing::HasSubstr;

constexpr char kHall[] = R"(
[world]
half_extent_m = 10.0
[[world.obstacle]]
kind = "box"
x_m = 4.0
y_m = 5.0
length_m = 2.0
width_m = 1.0
[[world.obstacle]]
kind = "cylinder"
x_m = -6.0
y_m = -3.0
radius_m = 0.5
[path]
kind = "line"
length_m = 4.0
[run]
duration_s = 10
[sensor]
odometry_rate_hz = 50
[lidar]
model = "custom"
noise_m = 0.02
)";

Scenario scenario(const std::vector<std::string>& more) {
  return parse_scenario(kHall, "hall.toml", more);
}

/// The node, and what it says of a vehicle that stands at the start.
struct Bench {
  VirtualWorld world;
  Scenario settings;
  std::vector<Shape> shapes;
  std::unique_ptr<LocaliserNode> node;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<localisation_t>> found;
  std::vector<Seen<counters_t>> counters;
  RandomEngine random = random_stream(1, "scanner");

  explicit Bench(const std::vector<std::string>& more)
      : settings(scenario(more)), shapes(mapped_shapes(HallSettings(settings))) {
    const bool at_edge = settings.get<LocaliserSettings>().place == LocaliserSettings::Place::edge;
    const std::string side = at_edge ? "CTRL" : "AGV";
    node = std::make_unique<LocaliserNode>(settings, world.loop, world.bus);
    world.collect(side + "/POSE", poses);
    world.collect(side + "/LOCALISATION", found);
    world.collect("AGV/LOCALISER_COUNTERS", counters);
  }

  Scan scan(int ms, std::int64_t seq, const Pose2& at = {}) {
    Scan out = HallScanner().measure(
        shapes, at_ms(ms), seq, [&](Instant) { return at; }, random);
    out.plan = {7, seq};
    return out;
  }
  void scan_at(int ms, std::int64_t seq, std::int64_t run = 0, const Pose2& at = {}) {
    const Scan one = scan(ms, seq, at);
    world.publish_at(one.end(), "AGV/SCAN", scan_message(one, run));
  }
  void parts_at(int ms, std::int64_t seq, int lost) {
    const Scan one = scan(ms, seq);
    const auto parts = scan_parts(one, 0, 3 * seq, 600, 0.001);
    ASSERT_EQ(parts.size(), 3U);
    for (int i = 0; i < 3; ++i) {
      if (i != lost) {
        world.publish_at(one.end(), "CTRL/SCAN_PART", parts[static_cast<std::size_t>(i)]);
      }
    }
  }
  void odometry(const std::string& channel = "AGV/ODOMETRY") {
    for (int i = 0; i < 50; ++i) {
      world.publish_at(at_ms(20 * i), channel, odometry_message(at_ms(20 * i), i, {}, {}));
    }
  }
  std::int64_t counted(const std::string& name) {
    node->finish();
    world.loop.run_until(world.loop.now());
    return counters.empty() ? -2 : test::counter(counters.back().message, name);
  }
};

TEST(LocaliserNode, MakesAPoseOfEachScanStampedWithItsEndAndNamingItsPlan) {
  Bench bench({"localiser.place=vehicle"});
  bench.odometry();
  for (int i = 0; i < 10; ++i) bench.scan_at(67 * i, i);
  bench.world.loop.run_until(at_s(1));
  ASSERT_EQ(bench.poses.size(), 10U);
  for (int i = 0; i < 10; ++i) {
    const auto& [when, pose] = bench.poses[static_cast<std::size_t>(i)];
    EXPECT_EQ(pose.utime, 67'000 * i + 50'000);
    EXPECT_EQ(when, at_ms(67 * i + 50));
    EXPECT_EQ(pose.seq, i);
    EXPECT_EQ(pose.plan_session, 7);
    EXPECT_EQ(pose.plan_id, i);
    EXPECT_NEAR(pose.x_m, 0.0, 0.01);
    EXPECT_NEAR(pose.y_m, 0.0, 0.01);
    EXPECT_NEAR(pose.yaw_rad, 0.0, 0.002);
    const auto& said = bench.found[static_cast<std::size_t>(i)].message;
    EXPECT_EQ(said.state, localisation_t::TRACKING);
    EXPECT_EQ(said.utime, pose.utime);
    EXPECT_EQ(said.scan_seq, i);
    EXPECT_GT(said.beams, 500);
    EXPECT_GT(said.cov_x_x_m2, 0.0);
  }
}

TEST(LocaliserNode, GivesNoPoseWhileItSearches) {
  Bench bench({"localiser.place=vehicle", "localiser.knows_start=false"});
  bench.odometry();
  for (int i = 0; i < 4; ++i) bench.scan_at(67 * i, i);
  bench.world.loop.run_until(at_s(1));
  EXPECT_TRUE(bench.poses.empty());
  ASSERT_EQ(bench.found.size(), 4U);
  EXPECT_EQ(bench.found.front().message.state, localisation_t::SEARCHING);
}

TEST(LocaliserNode, CountsAndIgnoresWhatItCannotUse) {
  Bench bench({"localiser.place=vehicle"});
  bench.odometry();
  bench.scan_at(0, 0);
  bench.scan_at(100, 1, 5);                                         // scan of another run
  bench.world.publish_bytes_at(at_ms(200), "AGV/SCAN", {1, 2, 3});  // no message
  scan_t empty = scan_message(bench.scan(250, 2), 0);
  empty.angle_increment_rad = -1.0;
  bench.world.publish_at(at_ms(300), "AGV/SCAN", empty);
  bench.scan_at(350, 3);
  bench.world.publish_at(at_ms(450), "AGV/SCAN", scan_message(bench.scan(350, 3), 0));   // again
  bench.world.publish_at(at_ms(460), "AGV/SCAN", scan_message(bench.scan(5000, 4), 0));  // future
  odometry_t broken = odometry_message(at_ms(470), 60, {}, {});
  broken.x_m = std::nan("");
  bench.world.publish_at(at_ms(470), "AGV/ODOMETRY", broken);
  bench.world.publish_bytes_at(at_ms(480), "AGV/ODOMETRY", {1});
  bench.world.loop.run_until(at_s(1));
  EXPECT_EQ(bench.poses.size(), 2U);
  EXPECT_EQ(bench.counted("scan.other_run"), 1);
  EXPECT_EQ(bench.counted("scan.undecodable"), 1);
  EXPECT_EQ(bench.counted("scan.unusable"), 1);
  EXPECT_EQ(bench.counted("scan.duplicated"), 1);
  EXPECT_EQ(bench.counted("scan.from_future"), 1);
  EXPECT_EQ(bench.counted("odometry.unusable"), 1);
  EXPECT_EQ(bench.counted("odometry.undecodable"), 1);
  EXPECT_EQ(bench.counted("pose.sent"), 2);
}

TEST(LocaliserNode, AtTheEdgeUsesWhatArrivedOfAScanAndWaitsNoLongerThanItsPatience) {
  Bench bench({"localiser.place=edge", "localiser.scan_patience_ms=30"});
  bench.odometry("CTRL/ODOMETRY");
  bench.parts_at(0, 0, -1);   // all arrive
  bench.parts_at(200, 1, 1);  // the middle one is lost
  bench.world.loop.run_until(at_s(1));
  ASSERT_EQ(bench.poses.size(), 2U);
  EXPECT_EQ(bench.poses[0].when, at_ms(50));
  EXPECT_EQ(bench.poses[0].message.plan_id, 0);
  EXPECT_EQ(bench.poses[1].when, at_ms(280));
  EXPECT_EQ(bench.poses[1].message.utime, 250'000);
  EXPECT_LT(bench.found[1].message.beams, 400);
  EXPECT_GT(bench.found[1].message.beams, 300);
  EXPECT_NEAR(bench.poses[1].message.x_m, 0.0, 0.02);
  EXPECT_EQ(bench.counted("scan.complete"), 1);
  EXPECT_EQ(bench.counted("scan.incomplete"), 1);
}

TEST(LocaliserNode, NeedsOdometryAndAScanner) {
  const auto refusal = [](const std::vector<std::string>& more) -> std::string {
    try {
      scenario(more);
    } catch (const UsageError& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_THAT(refusal({"localiser.place=vehicle", "sensor.odometry_rate_hz=0"}),
              HasSubstr("sensor.odometry_rate_hz"));
  EXPECT_THAT(refusal({"localiser.place=edge", "lidar.model=none"}), HasSubstr("lidar.model"));
  EXPECT_THAT(refusal({"localiser.place=cloud"}), HasSubstr("localiser.place"));
  EXPECT_THAT(refusal({"localiser.particles=5000"}), HasSubstr("localiser.place"));
  EXPECT_THAT(refusal({"localiser.place=vehicle", "localiser.resolution_m=0"}),
              HasSubstr("localiser.resolution_m"));
}

TEST(LocaliserNode, KnowsItsScannerUnlessItsNoiseIsGiven) {
  const Scenario known =
      scenario({"localiser.place=vehicle", "lidar.noise_m=0.03", "lidar.height_m=0.35"});
  EXPECT_EQ(known.get<LocaliserSettings>().range_noise_m, 0.03);
  EXPECT_EQ(known.get<LocaliserSettings>().scan_height_m, 0.35);
  const Scenario told = scenario({"localiser.place=vehicle", "localiser.range_noise_m=0.05"});
  EXPECT_EQ(told.get<LocaliserSettings>().range_noise_m, 0.05);
}

TEST(LocaliserNode, OfWhichNothingIsInAResolvedScenarioWithoutIt) {
  EXPECT_EQ(to_toml(scenario({})).find("localiser"), std::string::npos);
  EXPECT_NE(to_toml(scenario({"localiser.place=vehicle"})).find("[localiser]"), std::string::npos);
}

}  // namespace
}  // namespace tether
