#include <gmock/gmock.h>

#include <cmath>
#include <tether/scan_t.hpp>
#include <thread>

#include "common/base/errors.hpp"
#include "common/fleet/fleet.hpp"
#include "common/node/message_io.hpp"
#include "tests/loop/lockstep_rig.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tests/tools/runs/run_files.hpp"
#include "tools/runs/run_observer.hpp"

namespace tether {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::record_of;
using test::run_into;
using ::testing::HasSubstr;

Scenario fleet(std::vector<std::string> overrides) {
  overrides.insert(overrides.begin(), {"vehicle.plant=kinematic", "run.duration_s=20"});
  return load_scenario(in_source("/scenarios/paper.toml"), overrides);
}

/// Side by side, far from each other.
std::vector<std::string> apart(int count) {
  return {"fleet.count=" + std::to_string(count), "fleet.phases=none", "fleet.offset_x_m=50",
          "world.half_extent_m=400"};
}

std::string refusal(const std::vector<std::string>& overrides) {
  return refusal_of([&] { fleet(overrides); });
}

TEST(Fleet, ItsVehiclesHaveNamesAndBeginEvenlySpreadOnTheirPath) {
  const auto members = fleet_members(fleet({"fleet.count=7"}));
  ASSERT_EQ(members.size(), 7U);
  EXPECT_EQ(members[6].get<VehicleSettings>().name, "AGV7");
  for (std::size_t i = 0; i < members.size(); ++i) {
    const double theta = 2.0 * M_PI * static_cast<double>(i) / 7.0;
    const auto& start = members[i].get<VehicleSettings>();
    const double u = 20.0 * std::sin(theta), w = u * std::cos(theta), c = std::sqrt(0.5);
    EXPECT_NEAR(start.start_x_m, c * (u + w), 1e-9);
    EXPECT_NEAR(start.start_y_m, c * (w - u), 1e-9);
  }
}

TEST(Fleet, OfOneVehicleIsTheScenarioItself) {
  const Scenario scenario = fleet({});
  EXPECT_EQ(to_toml(fleet_members(scenario).front()), to_toml(scenario));
  EXPECT_EQ(to_toml(scenario).find("fleet"), std::string::npos);
}

TEST(Fleet, AVehicleThatMeetsNoOtherDrivesAsIfItWereAlone) {
  auto overrides = apart(3);
  overrides.insert(overrides.end(), {"channel.prr=0.6", "channel.delay_ms=50", "sensor.rate_hz=20",
                                     "sensor.position_noise_m=0.02"});
  ClosedLoop all(fleet(overrides));
  all.run();
  for (std::size_t i = 0; i < 3; ++i) {
    ClosedLoop alone(all.members()[i]);
    alone.run();
    EXPECT_EQ(all.sim(i).metrics().epsilon_m(), alone.sim().metrics().epsilon_m()) << i;
    EXPECT_EQ(all.netem(i).uplink().counters().lost, alone.netem().uplink().counters().lost) << i;
    EXPECT_EQ(all.sim(i).collisions(), 0);
  }
  EXPECT_NE(all.netem(0).uplink().counters().lost, all.netem(1).uplink().counters().lost);
}

TEST(Fleet, OneVehicleMoreLeavesTheLuckOfTheOthersAsItWas) {
  std::vector<double> two, three;
  for (auto* errors : {&two, &three}) {
    auto overrides = apart(errors == &two ? 2 : 3);
    overrides.insert(overrides.end(), {"channel.prr=0.5", "sensor.rate_hz=20"});
    ClosedLoop loop(fleet(overrides));
    loop.run();
    for (std::size_t i = 0; i < 2; ++i) errors->push_back(loop.sim(i).metrics().epsilon_m());
  }
  EXPECT_EQ(two, three);
}

TEST(Fleet, TheSameSeedGivesTheSameBytesInAnyThread) {
  const Scenario scenario =
      fleet({"fleet.count=5", "channel.prr=0.6", "fleet.phases=random", "sensor.rate_hz=5"});
  std::vector<std::size_t> hashes(3);
  std::vector<std::thread> threads;
  for (std::size_t& hash : hashes) {
    threads.emplace_back([&] { hash = record_of(scenario).hash(); });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(hashes, std::vector<std::size_t>(3, hashes.front()));
}

TEST(Fleet, InLockstepItIsTheSameRun) {
  const Scenario scenario = fleet({"fleet.count=3", "medium.model=dcf", "run.duration_s=5",
                                   "sensor.rate_hz=10", "sensor.odometry_rate_hz=20"});
  test::LockstepRig rig(scenario);
  rig.run();
  EXPECT_TRUE(rig.record == record_of(scenario));
}

TEST(Fleet, AllShareOneMedium) {
  auto overrides = apart(4);
  overrides.insert(overrides.end(), {"medium.model=dcf", "sensor.rate_hz=20"});
  const Scenario scenario = fleet(overrides);
  ClosedLoop loop(scenario);
  const FleetObserver observer(loop.members(), loop.loop(), loop.bus());
  loop.run();
  std::int64_t arrived = 0;  // poses and commands behind it
  for (std::size_t i = 0; i < 4; ++i) {
    for (const Link* link : {&loop.netem(i).uplink(), &loop.netem(i).downlink()}) {
      arrived += link->counters().offered;
    }
  }
  EXPECT_GT(arrived, 4 * 2 * 20 * 19);
  EXPECT_EQ(observer.counters()["netem.medium.delivered"], arrived);
}

TEST(Fleet, ItsFilesReproduceTheRun) {
  const Folder folder;
  run_into(folder.path / "a", fleet({"fleet.count=3", "run.duration_s=3"}));
  run_into(folder.path / "b", load_scenario((folder.path / "a" / "scenario.toml").string(), {}));
  for (const char* file : {"run.lcmlog", "trajectories.csv"}) {
    EXPECT_EQ(test::contents(folder.path / "a" / file), test::contents(folder.path / "b" / file))
        << file;
  }
  const std::string rows = test::contents(folder.path / "a" / "trajectories.csv");
  EXPECT_THAT(rows, HasSubstr("\nAGV1,"));
  EXPECT_THAT(rows, HasSubstr("\n\n\nvehicle,t_s,x_m"));
  EXPECT_THAT(rows, HasSubstr("\nAGV3,"));
  EXPECT_FALSE(fs::exists(folder.path / "a" / "trajectory.csv"));
}

TEST(Fleet, AScannerSeesTheVehicleInFrontOfIt) {
  // AGV2 stands 6 m ahead of AGV1, and both face along x.
  ClosedLoop loop(fleet({"path.kind=line", "path.length_m=1", "channel.prr=0", "fleet.count=2",
                         "fleet.phases=none", "fleet.offset_x_m=6", "run.duration_s=1",
                         "lidar.model=sick_nanoscan3", "sensor.odometry_rate_hz=50"}));
  double ahead_m = 0.0, mount_x_m = 0.0;
  std::int64_t undecodable = 0;
  subscribe<scan_t>(loop.bus(), "AGV1/SCAN", kDeepQueue, undecodable, [&](const scan_t& scan) {
    mount_x_m = scan.mount_x_m;
    ahead_m = scan.range_m.at(static_cast<std::size_t>(
        std::lround(-(scan.mount_yaw_rad + scan.angle_min_rad) / scan.angle_increment_rad)));
  });
  loop.run();
  const auto& vehicle = loop.members().front().get<VehicleSettings>();
  const double rear_x_m =
      6.0 - vehicle.axle_x_m - 0.5 * vehicle.chassis_length_m;  // from AGV1's axle
  EXPECT_NEAR(ahead_m, rear_x_m - mount_x_m, 0.1);
}

TEST(Fleet, RefusesWhatItCannotBe) {
  EXPECT_THAT(refusal({"fleet.count=2", "fleet.phases=none"}),
              HasSubstr("fleet.count = 2: AGV2 would start where AGV1 stands"));
  EXPECT_THAT(refusal({"fleet.count=0"}), HasSubstr("fleet.count"));
  EXPECT_THAT(refusal({"fleet.offset_x_m=3"}), HasSubstr("fleet.count"));
  EXPECT_THAT(refusal({"fleet.count=1001"}), HasSubstr("a whole number from 1 to 1000"));
  EXPECT_THAT(refusal({"fleet.count=3", "vehicle.start_x_m=1"}),
              HasSubstr("each vehicle starts where its path begins: leave out vehicle.start_x_m"));
  EXPECT_THAT(refusal({"fleet.count=3", "path.kind=line", "path.length_m=4"}),
              HasSubstr("path.phase = 0.333"));
  EXPECT_THAT(refusal({"fleet.count=3", "fleet.phases=none", "fleet.offset_x_m=30"}),
              HasSubstr("AGV2"));
  EXPECT_THAT(refusal({"fleet.count=7", "vehicle.drivetrain=can",
                       "can.drivetrain=" + in_source("/drivetrains/two_node_cia402.toml")}),
              HasSubstr("a CAN bus is one vehicle's"));
}

}  // namespace
}  // namespace tether
