#include <gtest/gtest.h>

#include <tether/scan_part_t.hpp>
#include <tether/scan_t.hpp>

#include "common/world/scan.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::twist;
using test::VirtualWorld;

struct ScanningTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<scan_t>> scans;
  std::vector<Seen<scan_part_t>> parts;
  std::vector<Seen<pose_t>> poses;
  std::unique_ptr<SimNode> node;

  ScanningTest() {
    scenario.get<VehicleSettings>().plant = VehicleSettings::Plant::kinematic;
    auto& lidar = scenario.get<LidarSettings>();
    lidar = lidar_preset("custom");
    lidar.mount_x_m = 0.0;
    lidar.height_m = 1.0;
  }
  void run(double duration_s) {
    world.collect("AGV/SCAN", scans);
    world.collect("AGV/SCAN_PART", parts);
    world.collect("AGV/POSE", poses);
    node = std::make_unique<SimNode>(scenario, world.loop, world.bus);
    world.loop.run_until(at_s(duration_s));
  }
};

TEST_F(ScanningTest, PublishesEachTurnWhenItsLastBeamIsMeasured) {
  run(1.0);
  ASSERT_EQ(scans.size(), 15U);
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const auto scan = to_scan(scans[k].message);
    ASSERT_TRUE(scan);
    EXPECT_EQ(scan->seq, static_cast<std::int64_t>(k));
    EXPECT_NEAR(to_seconds(scan->stamp), static_cast<double>(k) / 15.0, 2e-6);
    EXPECT_NEAR(to_seconds(scans[k].when - scan->end()), 0.0, 2e-6);
    EXPECT_EQ(scan->range_m.size(), 541U);
  }
  EXPECT_TRUE(parts.empty());
  EXPECT_EQ(poses.size(), 21U) << "no other source of poses";
}

TEST_F(ScanningTest, SeesTheHallFromWhereTheVehicleIsByThen) {
  auto& lidar = scenario.get<LidarSettings>();
  lidar.noise_m = lidar.range_step_m = 0.0;
  world.publish_at(at_s(0), "AGV/CMD_VEL", twist(at_s(0), 0, 1.5, 0.0));
  run(3.0);
  const Scan scan = to_scan(scans.back().message).value();
  const double ahead_m = 1.5 * to_seconds(scan.time_of(270)) - 0.5 * 1.5 * 1.5 / 3.0;
  EXPECT_NEAR(scan.range_m[270], scenario.get<WorldSettings>().half_extent_m - ahead_m, 2e-3);
}

TEST_F(ScanningTest, WithALocaliserOnTheVehicleThereAreNoPoses) {
  scenario.get<LocaliserSettings>().place = LocaliserSettings::Place::vehicle;
  run(1.0);
  EXPECT_TRUE(poses.empty());
  EXPECT_TRUE(parts.empty());
  EXPECT_EQ(scans.size(), 15U);
}

TEST_F(ScanningTest, WithALocaliserAtTheEdgeScansGoInParts) {
  scenario.get<LocaliserSettings>().place = LocaliserSettings::Place::edge;
  scenario.get<LocaliserSettings>().part_bytes = 600.0;
  run(1.0);
  EXPECT_TRUE(poses.empty());
  ASSERT_EQ(parts.size(), 45U);
  ScanAssembly assembly(std::chrono::milliseconds{30});
  std::size_t k = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i].message.seq, static_cast<std::int64_t>(i));
    EXPECT_LE(parts[i].message.getEncodedSize(), 600);
    const auto whole = assembly.add(parts[i].message);
    if (!whole) continue;
    const Scan scan = to_scan(scans.at(k++).message).value();
    EXPECT_EQ(whole->seq, scan.seq);
    for (std::size_t b = 0; b < scan.range_m.size(); ++b) {
      EXPECT_NEAR(whole->range_m[b], scan.range_m[b], 0.0005001);
    }
  }
  EXPECT_EQ(k, 15U);
}

TEST_F(ScanningTest, StampsAreOfTheVehiclesClock) {
  scenario.get<VehicleSettings>().clock_offset_ms = 7.0;
  run(0.2);
  EXPECT_EQ(scans.front().message.utime, 7'000);
}

TEST_F(ScanningTest, IsTheSameTwice) {
  run(1.0);
  VirtualWorld again;
  std::vector<Seen<scan_t>> second;
  again.collect("AGV/SCAN", second);
  SimNode twin(scenario, again.loop, again.bus);
  again.loop.run_until(at_s(1.0));
  ASSERT_EQ(second.size(), scans.size());
  for (std::size_t k = 0; k < scans.size(); ++k) {
    EXPECT_EQ(second[k].message.range_m, scans[k].message.range_m);
  }
}

TEST_F(ScanningTest, ChangesNothingForPoses) {
  scenario.get<SensorSettings>().position_noise_m = 0.01;
  run(1.0);
  VirtualWorld again;
  std::vector<Seen<pose_t>> without;
  scenario.get<LidarSettings>() = {};
  again.collect("AGV/POSE", without);
  SimNode twin(scenario, again.loop, again.bus);
  again.loop.run_until(at_s(1.0));
  ASSERT_EQ(without.size(), poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    EXPECT_EQ(without[k].message.x_m, poses[k].message.x_m);
  }
}

// ---------------------------------------------------------------------------- autonomy

struct DriveTest : ScanningTest {
  DriveTest() {
    scenario.get<LidarSettings>() = {};
    scenario.get<AutonomySettings>().enabled = true;
    scenario.get<ActuatorSettings>().policy = "hold";
  }
  double speed_mps() { return node->vehicle().state().twist.v_mps; }
};

TEST_F(DriveTest, OfAVehicleThatDecidesItselfCountsAndNothingElse) {
  world.publish_at(at_s(0), "AGV/CMD_VEL", twist(at_s(0), 0, 1.0, 0.0));
  run(0.9);
  EXPECT_EQ(speed_mps(), 0.0) << "the remote controller's command is the autonomy's to judge";
  for (int i = 0; i < 10; ++i) {
    const Instant when = at_s(1.0 + 0.1 * i);
    world.publish_at(when, "AGV/DRIVE", twist(when, i, 0.5, 0.0));
  }
  world.loop.run_until(at_s(2.0));
  EXPECT_NEAR(speed_mps(), 0.5, 1e-9);
}

TEST_F(DriveTest, EndsInAStopWithoutANewOne) {
  world.publish_at(at_s(1), "AGV/DRIVE", twist(at_s(1), 0, 0.3, 0.0));
  run(1.15);
  EXPECT_NEAR(speed_mps(), 0.3, 1e-9);
  world.loop.run_until(at_s(1.5));
  EXPECT_EQ(speed_mps(), 0.0) << "0.2 s later it brakes";
}

}  // namespace
}  // namespace tether
