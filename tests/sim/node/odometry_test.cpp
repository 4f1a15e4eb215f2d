#include <gtest/gtest.h>

#include <cmath>
#include <tether/odometry_t.hpp>

#include "sim/node/sim_node.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::Seen;
using test::twist;
using test::VirtualWorld;

struct OdometryTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<odometry_t>> odometry;
  std::unique_ptr<SimNode> node;

  OdometryTest() {
    scenario.get<VehicleSettings>().plant = VehicleSettings::Plant::kinematic;
    scenario.get<SensorSettings>().odometry_rate_hz = 5.0;
  }
  /// Drives for 10 s.
  void drive(double v_mps, double omega_radps) {
    world.collect("AGV/ODOMETRY", odometry);
    node = std::make_unique<SimNode>(scenario, world.loop, world.bus);
    world.publish_at(at_s(0), "AGV/CMD_VEL", twist(at_s(0), 0, v_mps, omega_radps));
    world.loop.run_until(at_s(10));
  }
  Pose2 truth() { return node->vehicle().state().pose; }
  const odometry_t& newest() const { return odometry.back().message; }
};

TEST_F(OdometryTest, IsTheTruthForWheelsThatAreAsBelieved) {
  drive(1.0, 0.3);
  ASSERT_EQ(odometry.size(), 51U);
  EXPECT_EQ(odometry[1].when, at_ms(200));
  EXPECT_EQ(odometry[1].message.utime, 200'000);
  EXPECT_EQ(newest().seq, 50);
  // Read each 10 ms: while the wheels speed up, an arc is off by less than 1 um.
  EXPECT_NEAR(newest().x_m, truth().x_m, 1e-4);
  EXPECT_NEAR(newest().y_m, truth().y_m, 1e-4);
  EXPECT_NEAR(newest().yaw_rad, truth().yaw_rad, 1e-9);
  EXPECT_NEAR(newest().v_mps, 1.0, 1e-12);
  EXPECT_NEAR(newest().omega_radps, 0.3, 1e-12);
}

TEST_F(OdometryTest, KnowsNothingOfLargerWheels) {
  scenario.get<VehicleSettings>().radius_error = 0.02;
  drive(1.0, 0.0);
  EXPECT_NEAR(truth().x_m / newest().x_m, 1.02, 1e-9);
  EXPECT_NEAR(newest().v_mps, 1.0, 1e-12) << "it believes that it goes as fast as commanded";
}

TEST_F(OdometryTest, KnowsNothingOfANarrowerTrack) {
  scenario.get<VehicleSettings>().track_error = 0.05;
  drive(0.0, 0.2);
  EXPECT_NEAR(truth().yaw_rad / newest().yaw_rad, 1.05, 1e-9);
  EXPECT_NEAR(newest().omega_radps, 0.2, 1e-12);
}

TEST_F(OdometryTest, BeginsAtTheNominalStart) {
  scenario.get<VehicleSettings>().start_error_m = 0.3;
  drive(0.0, 0.0);
  EXPECT_EQ(newest().x_m, 0.0);
  EXPECT_NE(truth().x_m, 0.0);
}

TEST_F(OdometryTest, BecomesLessCertainAlongTheWay) {
  drive(1.0, 0.0);
  // Straight on, each wheel k^2 a metre: along half of that, the yaw twice of it over track^2.
  const double way_m = newest().distance_m;
  EXPECT_NEAR(newest().cov_x_x_m2, 1e-5 * way_m / 2.0, 1e-9);
  EXPECT_NEAR(newest().cov_yaw_yaw_rad2, 2.0 * 1e-5 * way_m / 1.44, 1e-9);
}

TEST_F(OdometryTest, IsNotSentByDefault) {
  scenario.get<SensorSettings>() = {};
  drive(1.0, 0.0);
  EXPECT_TRUE(odometry.empty());
}

}  // namespace
}  // namespace tether
