// The shipped AGVs of 200 kg and 1000 kg, and the physics' step, in the whole loop.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <tether/ground_truth_t.hpp>
#include <vector>

#include "common/base/errors.hpp"
#include "common/node/message_io.hpp"
#include "common/scenario/run_settings.hpp"
#include "common/vehicle/grip.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/node/sim_node.hpp"
#include "tests/support/refusal.hpp"
#include "tests/support/source_dir.hpp"
#include "tools/nodes/closed_loop.hpp"

namespace tether {
namespace {

using ::testing::HasSubstr;

Scenario shipped(const std::string& name, const std::vector<std::string>& overrides = {}) {
  return load_scenario(in_source("/scenarios/") + name + ".toml", overrides);
}

std::string refusal(const std::string& name, const std::vector<std::string>& overrides) {
  return refusal_of([&] { shipped(name, overrides); });
}

Metrics run(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  loop.run();
  return loop.sim().metrics();
}

const std::vector<std::string> kPid{"controller.law=pid", "actuator.policy=hold"};

TEST(AgvLoop, TheAgvsWeighWhatTheirNamesSay) {
  EXPECT_NEAR(vehicle_weight(shipped("agv_200kg").get<VehicleSettings>()).mass_kg, 200.0, 0.01);
  EXPECT_NEAR(vehicle_weight(shipped("agv_1000kg").get<VehicleSettings>()).mass_kg, 1000.0, 0.01);
}

// Measured over the whole run: 0.010 and 0.017 m with plans, 0.13 and 0.22 m with the PID.
TEST(AgvLoop, TheAgvsFollowTheirPaths) {
  for (const std::string name : {"agv_200kg", "agv_1000kg"}) {
    const Metrics plans = run(shipped(name, {"run.duration_s=40"}));
    EXPECT_LT(plans.epsilon_m(), 0.03) << name;
    EXPECT_LT(plans.max_error_m(), 0.1) << name;
    std::vector<std::string> pid = kPid;
    pid.emplace_back("run.duration_s=40");
    EXPECT_LT(run(shipped(name, pid)).epsilon_m(), 0.3) << name;
  }
}

/// The largest motor torque in SIM/TRUTH.
double largest_torque(const Scenario& scenario) {
  ClosedLoop loop(scenario);
  double largest_Nm = 0.0;
  std::int64_t undecodable = 0;
  subscribe<ground_truth_t>(
      loop.bus(), "SIM/TRUTH", kDeepQueue, undecodable, [&](const ground_truth_t& m) {
        largest_Nm =
            std::max({largest_Nm, std::abs(m.left_torque_Nm), std::abs(m.right_torque_Nm)});
      });
  loop.run();
  EXPECT_EQ(undecodable, 0);
  return largest_Nm;
}

TEST(AgvLoop, NoTorqueInTheLogIsBeyondTheMotorsLimit) {
  for (const std::string name : {"agv_200kg", "agv_1000kg"}) {
    const Scenario as_it_is = shipped(name, {"run.duration_s=15"});
    const double limit_Nm = as_it_is.get<VehicleSettings>().max_wheel_torque_Nm;
    const double largest_Nm = largest_torque(as_it_is);
    EXPECT_GT(largest_Nm, 0.25 * limit_Nm) << name;
    EXPECT_LE(largest_Nm, limit_Nm * (1.0 + 1e-6)) << name;
    const double weak_Nm = 0.7 * largest_Nm;
    const Scenario weak = shipped(
        name, {"run.duration_s=15", "vehicle.max_wheel_torque_Nm=" + std::to_string(weak_Nm)});
    EXPECT_NEAR(largest_torque(weak), weak_Nm, 1e-5 * weak_Nm) << name;
  }
  EXPECT_EQ(largest_torque(shipped("paper", {"run.duration_s=5", "vehicle.plant=kinematic"})), 0.0);
}

/// How far the vehicle is off where it is with a fine step, after 20 s.
double step_error_m(const std::string& step_ms, const Position& fine) {
  ClosedLoop loop(shipped("agv_200kg", {"run.duration_s=20", "sensor.position_noise_m=0",
                                        "sensor.yaw_noise_rad=0", "world.step_ms=" + step_ms}));
  loop.run();
  const Position end = loop.sim().vehicle().position();
  return std::hypot(end.x_m - fine.x_m, end.y_m - fine.y_m);
}

TEST(AgvLoop, TheStepChangesTheRunByMillimetres) {
  ClosedLoop loop(shipped("agv_200kg", {"run.duration_s=20", "sensor.position_noise_m=0",
                                        "sensor.yaw_noise_rad=0", "world.step_ms=0.25"}));
  loop.run();
  const Position fine = loop.sim().vehicle().position();
  EXPECT_LT(step_error_m("0.5", fine), 2e-3);
  EXPECT_LT(step_error_m("1", fine), 4e-3);
  EXPECT_LT(step_error_m("2", fine), 1e-2);
}

TEST(AgvLoop, AStepThatDoesNotFitIsRefused) {
  for (const char* step : {"0.3", "3", "4", "7"}) {
    EXPECT_THAT(refusal("paper", {std::string("world.step_ms=") + step}),
                HasSubstr("the step must be whole microseconds and divide 10 ms"));
  }
  EXPECT_THAT(refusal("paper", {"world.step_ms=20"}), HasSubstr("a number in [0.05, 10]"));
  EXPECT_THAT(refusal("paper", {"world.step_ms=10", "sensor.rate_hz=200"}),
              HasSubstr("sensor.rate_hz = 200 asks for more than one pose a step"));
  EXPECT_THAT(refusal("paper", {"world.step_ms=10", "run.truth_rate_hz=200"}),
              HasSubstr("run.truth_rate_hz = 200 asks for more than one state a step"));
  EXPECT_THAT(refusal("hil_vcan", {"world.step_ms=10", "can.coupling_ms=5"}),
              HasSubstr("can.coupling_ms = 5 is shorter than a step: world.step_ms = 10"));
  for (const char* step : {"0.1", "0.125", "0.2", "0.25", "0.5", "1", "2", "2.5", "5", "10"}) {
    EXPECT_EQ(refusal("paper", {std::string("world.step_ms=") + step}), "accepted");
  }
}

TEST(AgvLoop, KeysOfTyresWithoutEffectAreRefused) {
  EXPECT_THAT(refusal("paper", {"vehicle.tyre_stiffness=30"}),
              HasSubstr("vehicle.tyre_stiffness has no effect: vehicle.tyre is \"rigid\""));
  EXPECT_EQ(refusal("paper", {"vehicle.tyre=brush", "vehicle.tyre_stiffness=30"}), "accepted");
  for (const char* key : {"vehicle.tyre=brush", "vehicle.anti_windup=true", "vehicle.chassis_z_m=1",
                          "vehicle.payload_z_m=1", "vehicle.tyre_relaxation_m=0.1"}) {
    EXPECT_THAT(refusal("paper", {"vehicle.plant=kinematic", key}),
                HasSubstr("has no effect: vehicle.plant is \"kinematic\""));
  }
}

}  // namespace
}  // namespace tether
