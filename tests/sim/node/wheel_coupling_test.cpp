#include <gtest/gtest.h>

#include <limits>
#include <tether/wheel_states_t.hpp>
#include <tether/wheel_targets_t.hpp>
#include <vector>

#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "sim/plant/ode_vehicle.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::Seen;
using test::VirtualWorld;

wheel_targets_t targets(Instant stamp, std::int64_t seq, double left_radps, double right_radps) {
  wheel_targets_t m{};
  m.utime = to_utime(stamp);
  m.seq = seq;
  m.left_speed_radps = left_radps;
  m.right_speed_radps = right_radps;
  return m;
}

struct WheelCouplingTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  OdeVehicle vehicle{scenario.get<VehicleSettings>(), scenario.get<WorldSettings>(),
                     std::chrono::milliseconds{1}};
  WheelCoupling coupling{scenario, world.loop, world.bus, vehicle};
};

TEST_F(WheelCouplingTest, TheWheelsStandBeforeTheFirstTarget) {
  EXPECT_EQ(coupling.in_force(kStart).left_mps, 0.0);
  EXPECT_EQ(coupling.in_force(kStart).right_mps, 0.0);
}

TEST_F(WheelCouplingTest, TheNewestTargetHoldsUntilTheTimeout) {
  world.publish_at(at_ms(10), "SIM/WHEEL_TARGETS", targets(at_ms(10), 0, 5.0, -2.5));
  world.loop.run_until(at_ms(10));
  EXPECT_DOUBLE_EQ(coupling.in_force(at_ms(10)).left_mps, 2.0);  // wheels of 0.4 m radius
  EXPECT_DOUBLE_EQ(coupling.in_force(at_ms(109)).right_mps, -1.0);
  EXPECT_EQ(coupling.in_force(at_ms(110)).right_mps, 0.0);
}

TEST_F(WheelCouplingTest, WhatCannotBeUsedRefreshesNothing) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  world.publish_at(at_ms(10), "SIM/WHEEL_TARGETS", targets(at_ms(10), 0, 5.0, 5.0));
  world.publish_at(at_ms(50), "SIM/WHEEL_TARGETS", targets(at_ms(50), 1, kNan, 5.0));
  world.publish_at(at_ms(60), "SIM/WHEEL_TARGETS", targets(at_ms(9), 2, 9.0, 9.0));
  world.publish_bytes_at(at_ms(70), "SIM/WHEEL_TARGETS", {1, 2, 3});
  world.loop.run_until(at_ms(80));
  EXPECT_DOUBLE_EQ(coupling.in_force(at_ms(109)).left_mps, 2.0);
  EXPECT_EQ(coupling.in_force(at_ms(110)).left_mps, 0.0);
  CounterList counters;
  coupling.list(counters);
  std::int64_t rejected = 0;
  for (const auto& [name, value] : counters) {
    if (name != "wheel_targets.accepted" && name != "wheel_targets.missed") rejected += value;
  }
  EXPECT_EQ(rejected, 3);
}

TEST_F(WheelCouplingTest, TheWheelsAreReportedWithTheirTime) {
  std::vector<Seen<wheel_states_t>> seen;
  world.collect("SIM/WHEELS", seen);
  coupling.publish_wheels(at_ms(20));
  coupling.publish_wheels(at_ms(25));
  world.loop.run_until(at_ms(25));
  ASSERT_EQ(seen.size(), 2u);
  EXPECT_EQ(seen[1].message.utime, 25'000);
  EXPECT_EQ(seen[1].message.seq, 1);
  EXPECT_EQ(seen[1].message.left_angle_rad, 0.0);
}

}  // namespace
}  // namespace tether
