#include "sim/node/traffic.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tether {
namespace {

constexpr Duration kStep = std::chrono::milliseconds{1};
constexpr double kStep_s = 1e-3;

struct Start {
  double x_m, y_m, yaw_rad, v_mps;
};

/// Vehicles in one hall, each driven straight on at a speed of its own.
class TrafficTest : public ::testing::TestWithParam<VehicleSettings::Plant> {
 protected:
  void put(const std::vector<Start>& starts) {
    WorldSettings world;
    Surroundings hall;
    VehicleSettings vehicle;
    vehicle.plant = GetParam();
    hall.vehicles_mps = vehicle.max_wheel_speed_mps;
    for (const Start& start : starts) {
      vehicle.start_x_m = start.x_m;
      vehicle.start_y_m = start.y_m;
      vehicle.start_yaw_rad = start.yaw_rad;
      plants.push_back(make_plant(vehicle, world, kStep, 1, hall));
      plants.back()->set_wheel_targets({start.v_mps, start.v_mps});
      Plant& plant = *plants.back();
      auto done = std::make_shared<Instant>(kStart);
      traffic.add(vehicle, plant, [&plant, done](Instant until) {
        for (; *done + kStep <= until; *done += kStep) {
          plant.set_time(to_seconds(*done));
          plant.step();
        }
      });
    }
    config = vehicle;
  }
  void run(double until_s) {
    for (; now < kStart + from_seconds(until_s); now += kStep) {
      for (std::size_t i = 0; i < plants.size(); ++i) traffic.advance(i, now + kStep);
      deepest_m = std::min(deepest_m, gap());
    }
  }
  double gap() const {
    double least_m = INFINITY;
    for (std::size_t i = 0; i < plants.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        for (const Shape& a : footprint(config, plants[i]->state().pose)) {
          for (const Shape& b : footprint(config, plants[j]->state().pose)) {
            least_m = std::min(least_m, gap_m(a, b));
          }
        }
      }
    }
    return least_m;
  }

  std::vector<std::unique_ptr<Plant>> plants;
  Traffic traffic{kStep};
  VehicleConfig config;
  Instant now = kStart;
  double deepest_m = INFINITY;
};

// The axle is 0.5 m behind the chassis' centre, whose half is 1 m long: the nose 1.5 m in front of
// the axle, the rear 0.5 m behind it.
// They go on pushing with equal force, so that nothing but chance moves both.
TEST_P(TrafficTest, TwoThatMeetHeadOnStopEachOtherAndNeitherGoesThroughTheOther) {
  put({{-4.0, 0.0, 0.0, 1.0}, {4.0, 0.0, M_PI, 1.0}});
  run(4.0);
  EXPECT_GE(traffic.collisions(0), 1);
  EXPECT_EQ(traffic.collisions(0), traffic.collisions(1));
  EXPECT_GT(deepest_m, -0.01);
  for (const auto& plant : plants) {
    EXPECT_NEAR(std::abs(plant->state().pose.x_m), 1.5, 0.3);
    EXPECT_NEAR(plant->state().twist.v_mps, 0.0, 0.15);
  }
}

TEST_P(TrafficTest, OneThatStandsIsPushedOnAndBothKeepTogether) {
  put({{-3.0, 0.0, 0.0, 1.0}, {2.0, 0.0, 0.0, 0.0}});
  run(6.0);
  EXPECT_GE(traffic.collisions(1), 1);
  EXPECT_GT(plants[1]->state().pose.x_m, 2.0);
  EXPECT_GT(deepest_m, -0.02);
  EXPECT_LT(gap(), 0.2);
}

TEST_P(TrafficTest, ThoseFarFromEachOtherMoveAsAlone) {
  put({{-3.0, 0.0, 0.0, 1.0}, {-3.0, 8.0, 0.0, 1.0}});
  run(3.0);
  const Pose2 in_company = plants[0]->state().pose;
  EXPECT_EQ(traffic.collisions(0), 0);
  plants.erase(plants.begin() + 1, plants.end());
  VehicleSettings vehicle;
  vehicle.plant = GetParam();
  vehicle.start_x_m = -3.0;
  const auto alone = make_plant(vehicle, {}, kStep, 1, {});
  alone->set_wheel_targets({1.0, 1.0});
  for (int i = 0; i < 3000; ++i) {
    alone->set_time(i * kStep_s);
    alone->step();
  }
  EXPECT_EQ(in_company.x_m, alone->state().pose.x_m);
}

INSTANTIATE_TEST_SUITE_P(EachPlant, TrafficTest,
                         ::testing::Values(VehicleSettings::Plant::ode,
                                           VehicleSettings::Plant::kinematic),
                         [](const auto& info) {
                           return std::string(
                               info.param == VehicleSettings::Plant::ode ? "ode" : "kinematic");
                         });

}  // namespace
}  // namespace tether
