#include "sim/node/sim_node.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <tether/clock_t.hpp>
#include <tether/counters_t.hpp>
#include <tether/ground_truth_t.hpp>
#include <utility>
#include <vector>

#include "common/scenario/run_settings.hpp"
#include "common/vehicle/actuator_settings.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/sensor/sensor_settings.hpp"
#include "tests/support/virtual_world.hpp"

namespace tether {
namespace {

using test::at_ms;
using test::at_s;
using test::counter;
using test::Seen;
using test::twist;
using test::VirtualWorld;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

// ---------------------------------------------------------------------------- metrics

TEST(Metrics, EpsilonIsTheTimeMeanOfTheError) {
  Metrics m;
  m.start(0.0);
  for (int i = 1; i <= 1000; ++i) m.add(0.001, 2.0 * i / 1000.0, 0.0);  // a ramp from 0 to 2
  EXPECT_NEAR(m.epsilon_m(), 1.0, 1e-12);
  EXPECT_NEAR(m.rmse_m(), 2.0 / std::sqrt(3.0), 1e-6);
  EXPECT_DOUBLE_EQ(m.max_error_m(), 2.0);
}

TEST(Metrics, BeforeAnyTimeHasPassedEpsilonIsTheErrorNow) {
  Metrics m;
  m.start(3.0);
  EXPECT_EQ(m.epsilon_m(), 3.0);
  EXPECT_EQ(m.rmse_m(), 3.0);
}

TEST(Metrics, CountsTimeAtTheWalls) {
  Metrics m;
  m.start(0.0);
  for (int i = 0; i < 10; ++i) m.add(0.001, 0.0, i < 4 ? 0.001 : 0.0);
  EXPECT_NEAR(m.wall_contact_s(), 0.004, 1e-12);
}

constexpr Metrics::Settings kQuick{.settled_from_s = 2.0, .lost_beyond_m = 1.0, .lost_for_s = 3.0};

/// Tells the metrics a piecewise linear error by its corners (t_s, error_m), in steps of 10 ms.
Metrics followed(const std::vector<std::pair<double, double>>& corners,
                 const Metrics::Settings& settings = kQuick) {
  Metrics m(settings);
  m.start(corners.front().second, corners.front().first);
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const auto [from_s, from_m] = corners[i - 1];
    const auto [to_s, to_m] = corners[i];
    const int steps = static_cast<int>(std::lround((to_s - from_s) * 100.0));
    for (int k = 1; k <= steps; ++k) {
      m.add((to_s - from_s) / steps, from_m + (to_m - from_m) * k / steps, 0.0);
    }
  }
  return m;
}

TEST(SettledMetrics, LeaveOutTheStart) {
  const Metrics m = followed({{0.0, 9.0}, {1.0, 0.0}, {2.0, 0.0}, {4.0, 0.5}});
  EXPECT_NEAR(m.settled_epsilon_m(), 0.25, 1e-9);
  EXPECT_NEAR(m.settled_max_error_m(), 0.5, 1e-9);
  EXPECT_EQ(m.max_error_m(), 9.0);
}

TEST(SettledMetrics, TakeTheStepInWhichTheyBeginInPart) {
  Metrics m(kQuick);
  m.start(4.0);
  m.add(4.0, 0.0, 0.0);  // 2 m at 2 s
  EXPECT_NEAR(m.settled_epsilon_m(), 1.0, 1e-12);
  EXPECT_NEAR(m.settled_max_error_m(), 2.0, 1e-12);
}

TEST(SettledMetrics, FromTheStartOnAreThoseOfTheWholeRun) {
  const Metrics m = followed({{0.0, 0.3}, {1.0, 0.7}, {3.0, 0.2}}, {.settled_from_s = 0.0});
  EXPECT_NEAR(m.settled_epsilon_m(), m.epsilon_m(), 1e-12);
  EXPECT_NEAR(m.settled_max_error_m(), m.max_error_m(), 1e-12);
}

TEST(SettledMetrics, OfAShorterRunAreTheErrorAtItsEnd) {
  const Metrics m = followed({{0.0, 0.9}, {1.5, 0.4}});
  EXPECT_EQ(m.settled_epsilon_m(), m.error_m());
  EXPECT_EQ(m.settled_max_error_m(), m.error_m());
}

TEST(LostVehicle, IsTheOneThatStaysBeyondTheLimitWithoutABreak) {
  EXPECT_TRUE(followed({{0.0, 2.0}, {3.01, 2.0}}).lost());
  EXPECT_FALSE(followed({{0.0, 2.0}, {2.99, 2.0}}).lost()) << "not long enough";
  EXPECT_FALSE(followed({{0.0, 1.0}, {9.0, 1.0}}).lost()) << "at the limit, not beyond";
  EXPECT_FALSE(followed({{0.0, 2.0}, {2.0, 2.0}, {2.1, 0.9}, {2.2, 2.0}, {4.5, 2.0}}).lost())
      << "two excursions are not one";
}

TEST(LostVehicle, IsLostSinceItPassedTheLimit) {
  const Metrics m = followed({{0.0, 0.0}, {4.0, 2.0}, {9.0, 2.0}});
  EXPECT_TRUE(m.lost());
  EXPECT_NEAR(m.lost_from_s(), 2.0, 1e-9);
  EXPECT_NEAR(m.away_s(), 7.0, 1e-9);
  EXPECT_EQ(m.return_s(), 0.0) << "it is not back";
}

TEST(LostVehicle, IsNotLostUpToNowBeforeIt) {
  EXPECT_NEAR(followed({{0.0, 0.0}, {4.0, 2.0}}).lost_from_s(), 4.0, 1e-9);
}

TEST(LostVehicle, WasLostEvenIfItIsBack) {
  const Metrics m = followed({{0.0, 2.0}, {4.0, 2.0}, {4.1, 0.0}, {9.0, 0.0}, {9.1, 2.0}});
  EXPECT_TRUE(m.lost());
  EXPECT_EQ(m.lost_from_s(), 0.0);
  EXPECT_NEAR(m.return_s(), 4.05, 1e-9);
  EXPECT_NEAR(m.away_s(), 0.05, 1e-9);
}

TEST(LostVehicle, TimeToReturnIsThatOfTheLongestExcursionThatIsOver) {
  const Metrics m = followed(
      {{0.0, 0.0}, {1.0, 2.0}, {2.0, 0.0}, {3.0, 4.0}, {4.0, 0.0}, {5.0, 2.0}, {5.5, 0.0}});
  EXPECT_NEAR(m.return_s(), 1.5, 1e-9);
  EXPECT_FALSE(m.lost());
  EXPECT_EQ(m.away_s(), 0.0);
}

TEST(LostVehicle, WithoutATimeToBeGivenIsLostAtOnce) {
  const Metrics m = followed({{0.0, 0.0}, {1.0, 1.1}}, {.lost_beyond_m = 1.0, .lost_for_s = 0.0});
  EXPECT_TRUE(m.lost());
}

// ---------------------------------------------------------------------------- node

struct SimNodeTest : ::testing::Test {
  Scenario scenario;
  VirtualWorld world;
  std::vector<Seen<pose_t>> poses;
  std::vector<Seen<ground_truth_t>> truth;
  std::vector<Seen<counters_t>> counters;
  std::unique_ptr<SimNode> node;

  void start() {
    world.collect("AGV/POSE", poses);
    world.collect("SIM/TRUTH", truth);
    world.collect("SIM/COUNTERS", counters);
    node = std::make_unique<SimNode>(scenario, world.loop, world.bus);
  }
  void command_at(double t_s, std::int64_t seq, double v_mps, double omega_radps) {
    world.publish_at(at_s(t_s), "AGV/CMD_VEL", twist(at_s(t_s), seq, v_mps, omega_radps));
  }
  std::int64_t count(const std::string& name) {
    node->finish();
    world.loop.run_until(world.loop.now());
    return counter(counters.back().message, name);
  }
  double speed_mps() const { return node->vehicle().state().twist.v_mps; }
};

TEST_F(SimNodeTest, PublishesPosesAtTheSensorsRateFromTheStartOn) {
  scenario.get<SensorSettings>().rate_hz = 4.0;
  start();
  world.loop.run_until(at_s(2));
  ASSERT_EQ(poses.size(), 9U);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(poses[i].when, at_ms(250.0 * static_cast<double>(i)));
    EXPECT_EQ(poses[i].message.utime, to_utime(poses[i].when));
    EXPECT_EQ(poses[i].message.seq, static_cast<std::int64_t>(i));
  }
}

TEST_F(SimNodeTest, SensorLatencyDelaysThePoseButNotItsTimeStamp) {
  scenario.get<SensorSettings>().rate_hz = 1.0;
  scenario.get<SensorSettings>().latency_ms = 80.0;
  start();
  world.loop.run_until(at_s(1.5));
  ASSERT_EQ(poses.size(), 2U);
  EXPECT_EQ(poses[1].when, at_ms(1080));
  EXPECT_EQ(poses[1].message.utime, 1'000'000);
}

TEST_F(SimNodeTest, ADropoutIsAGapInTimeButNotInTheNumbersOfPoses) {
  scenario.get<SensorSettings>().rate_hz = 10.0;
  scenario.get<SensorSettings>().dropouts_per_min = 30.0;
  start();
  world.loop.run_until(at_s(30));
  ASSERT_GT(poses.size(), 50U);
  ASSERT_LT(poses.size(), 290U);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_EQ(poses[i].message.seq, static_cast<std::int64_t>(i)) << "nothing was lost on the way";
  }
  EXPECT_EQ(count("pose.dropped"), 301 - static_cast<std::int64_t>(poses.size()));
}

TEST_F(SimNodeTest, PoseIsStampedWithTheStepItShows) {
  scenario.get<SensorSettings>().rate_hz = 30.0;  // 33.3 ms is no multiple of the 1 ms step
  start();
  world.loop.run_until(at_s(1));
  for (const auto& p : poses) {
    EXPECT_EQ(p.message.utime % 1000, 0);
    EXPECT_LT(p.when - from_utime(p.message.utime), std::chrono::milliseconds{1});
  }
}

TEST_F(SimNodeTest, ACommandActsFromTheFirstStepAfterItsArrival) {
  start();
  command_at(1.0004, 0, 1.0, 0.0);  // between two steps
  world.loop.run_until(at_ms(1001));
  EXPECT_NEAR(speed_mps(), 0.0, 1e-6);  // the step [1000, 1001) ms had begun before
  world.loop.run_until(at_ms(1003));
  EXPECT_GT(speed_mps(), 1e-4);
}

TEST_F(SimNodeTest, HoldKeepsDrivingWhenCommandsCease) {
  start();
  command_at(0.0, 0, 1.0, 0.0);
  world.loop.run_until(at_s(10));
  EXPECT_NEAR(speed_mps(), 1.0, 0.01);
}

TEST_F(SimNodeTest, ZeroPolicyBrakesAtTheTimeout) {
  scenario.get<ActuatorSettings>().policy = "zero";
  scenario.get<ActuatorSettings>().timeout_s = 0.5;
  start();
  command_at(0.0, 0, 0.3, 0.0);
  world.loop.run_until(at_ms(500));
  EXPECT_NEAR(speed_mps(), 0.3, 0.01);
  // 0.3 m/s at the servo's 3 m/s² takes 0.1 s to brake; 0.1 s more to settle.
  world.loop.run_until(at_ms(700));
  EXPECT_NEAR(speed_mps(), 0.0, 0.005);
}

TEST_F(SimNodeTest, NonFiniteCommandsNeverReachTheWheels) {
  start();
  command_at(1.0, 0, 0.5, 0.0);
  command_at(2.0, 1, kNaN, 0.0);
  command_at(2.1, 2, 0.0, kNaN);
  command_at(2.2, 3, kInf, 0.0);
  command_at(2.3, 4, 0.0, -kInf);
  command_at(2.4, 5, 1.7e308, 0.0);  // finite, but sums of it are not
  command_at(2.5, 6, 0.0, -1e9);
  world.loop.run_until(at_s(4));
  EXPECT_NEAR(speed_mps(), 0.5, 0.01);
  EXPECT_EQ(count("command.non_finite"), 6);
  EXPECT_EQ(count("command.accepted"), 1);
}

TEST_F(SimNodeTest, StaleCommandsNeverReachTheWheels) {
  start();
  command_at(2.0, 7, 0.5, 0.0);
  world.publish_at(at_s(2.1), "AGV/CMD_VEL", twist(at_s(2.0), 7, 0.5, 0.0));   // duplicate
  world.publish_at(at_s(2.2), "AGV/CMD_VEL", twist(at_s(1.5), 6, -3.0, 0.0));  // overtaken
  world.publish_at(at_s(2.3), "AGV/CMD_VEL", twist(at_s(1.9), 8, -3.0, 0.0));  // clock went back
  world.publish_at(at_s(2.4), "AGV/CMD_VEL", twist(at_s(99), 9, -3.0, 0.0));   // clock ahead
  world.publish_at(at_s(2.5), "AGV/CMD_VEL", twist(at_s(2.5), -1, -3.0, 0.0));
  world.loop.run_until(at_s(4));
  EXPECT_NEAR(speed_mps(), 0.5, 0.01);
  EXPECT_EQ(count("command.accepted"), 1);
  EXPECT_EQ(count("command.duplicated"), 1);
  EXPECT_EQ(count("command.reordered"), 1);
  EXPECT_EQ(count("command.time_backwards"), 1);
  EXPECT_EQ(count("command.from_future"), 1);
  EXPECT_EQ(count("command.invalid_seq"), 1);
}

TEST_F(SimNodeTest, RejectedCommandsDoNotRefreshTheTimeout) {
  scenario.get<ActuatorSettings>().policy = "zero";
  scenario.get<ActuatorSettings>().timeout_s = 0.5;
  start();
  command_at(1.0, 0, 0.3, 0.0);
  for (int i = 1; i < 20; ++i) command_at(1.0 + 0.1 * i, i, kNaN, 0.0);
  world.loop.run_until(at_s(1.9));
  EXPECT_NEAR(speed_mps(), 0.0, 0.005);
}

TEST_F(SimNodeTest, GarbageOnTheCommandChannelIsCountedAndIgnored) {
  start();
  world.publish_bytes_at(at_s(1), "AGV/CMD_VEL", {});
  world.publish_bytes_at(at_s(1), "AGV/CMD_VEL", std::vector<std::uint8_t>(7, 0xff));
  world.publish_bytes_at(at_s(1), "AGV/CMD_VEL", std::vector<std::uint8_t>(48, 0x80));
  world.publish_at(at_s(1), "AGV/CMD_VEL", test::pose(at_s(1), 0, 1.0, 1.0, 1.0));
  world.loop.run_until(at_s(2));
  EXPECT_NEAR(speed_mps(), 0.0, 1e-3);
  EXPECT_EQ(count("command.undecodable"), 4);
}

TEST_F(SimNodeTest, ExtremeCommandsAreScaledToTheWheelSpeedLimit) {
  start();
  command_at(0.0, 0, 9e8, -9e8);
  command_at(0.5, 1, -9e8, 9e8);
  world.loop.run_until(at_s(5));
  const VehicleState& s = node->vehicle().state();
  EXPECT_TRUE(is_usable(s.pose));
  EXPECT_LE(std::abs(s.rim_speeds.left_mps),
            scenario.get<VehicleSettings>().max_wheel_speed_mps + 0.5);
  EXPECT_LE(std::abs(s.rim_speeds.right_mps),
            scenario.get<VehicleSettings>().max_wheel_speed_mps + 0.5);
}

TEST_F(SimNodeTest, TheWorldStandsStillAfterTheRunsEnd) {
  scenario.get<RunSettings>().duration_s = 2.0;
  start();
  command_at(0.0, 0, 1.0, 0.0);
  world.loop.run_until(at_s(2));
  const double epsilon_m = node->metrics().epsilon_m();
  const double x_m = node->vehicle().state().pose.x_m;
  world.loop.run_until(at_s(5));
  EXPECT_EQ(node->metrics().epsilon_m(), epsilon_m);
  EXPECT_EQ(node->vehicle().state().pose.x_m, x_m);
  EXPECT_EQ(truth.back().message.utime, 2'000'000);
}

TEST_F(SimNodeTest, AVehicleThatNeverMovesHasTheKnownEpsilon) {
  scenario.get<RunSettings>().duration_s = 62.0;
  start();
  world.loop.run_until(at_s(62));
  // The path's mean distance from the origin over 62 s, by numerical integration: 14.79 m.
  EXPECT_NEAR(node->metrics().epsilon_m(), 14.79, 0.01);
  EXPECT_EQ(count("command.accepted"), 0);
}

}  // namespace
}  // namespace tether
