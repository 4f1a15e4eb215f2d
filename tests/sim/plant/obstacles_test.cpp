#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <memory>
#include <numbers>

#include "common/base/random.hpp"
#include "common/world/surroundings.hpp"
#include "sim/plant/plant.hpp"
#include "tests/sim/plant/plant_rig.hpp"

// Both plants between what stands and what moves in their hall.

namespace tether {
namespace {

using test::kStep;
using test::kStep_s;
using test::wheels;

using PlantKind = VehicleSettings::Plant;

Obstacle box_obstacle(double x_m, double y_m, double length_m = 1.0, double width_m = 1.0,
                      double yaw_rad = 0.0) {
  return {.pose = {x_m, y_m, yaw_rad}, .length_m = length_m, .width_m = width_m};
}

Obstacle cylinder(double x_m, double y_m, double radius_m) {
  return {.kind = Obstacle::Kind::cylinder, .pose = {x_m, y_m, 0.0}, .radius_m = radius_m};
}

Obstacle going(Obstacle obstacle, std::vector<Position> to, double speed_mps) {
  obstacle.to = std::move(to);
  obstacle.speed_mps = speed_mps;
  obstacle.speed_variation = 0.0;
  obstacle.pause_s = 0.0;
  obstacle.mapped = false;
  return obstacle;
}

Surroundings hall(std::vector<Obstacle> obstacles) {
  return {.map_file = "", .obstacles = std::move(obstacles)};
}

/// A driven vehicle; how far it may come into an obstacle is stated below.
class Driven {
 public:
  Driven(PlantKind kind, const Surroundings& surroundings, const Pose2& start = {},
         const WorldSettings& world = {})
      : surroundings_(surroundings), moving_(surroundings, 1), solid_(solid_shapes(surroundings)) {
    settings_.plant = kind;
    settings_.start_x_m = start.x_m;
    settings_.start_y_m = start.y_m;
    settings_.start_yaw_rad = start.yaw_rad;
    plant_ = make_plant(settings_, world, kStep, 1, surroundings_);
  }

  void drive(const WheelSpeeds& rim, double seconds) {
    plant_->set_wheel_targets(rim);
    for (long i = std::lround(seconds / kStep_s); i > 0; --i) step();
  }

  void step() {
    plant_->set_time(t_s_);
    plant_->step();
    t_s_ += kStep_s;
    const Pose2 pose = plant_->state().pose;
    for (const Shape& part : footprint(settings_, pose)) {
      for (const Shape& shape : solid_) deepest_m_ = std::max(deepest_m_, -gap_m(part, shape));
      for (const Shape& shape : moving_.at(t_s_)) {
        deepest_m_ = std::max(deepest_m_, -gap_m(part, shape));
      }
    }
    touched_ = touched_ || plant_->wall_contact();
  }

  VehicleState state() const { return plant_->state(); }
  bool touched() const { return touched_; }
  /// So far it has been in an obstacle at most.
  double deepest_m() const { return deepest_m_; }
  std::uint64_t complaints() const { return plant_->solver_complaints(); }

 private:
  VehicleSettings settings_;
  Surroundings surroundings_;
  MovingObstacles moving_;
  std::vector<Shape> solid_;
  std::unique_ptr<Plant> plant_;
  double t_s_ = 0.0;
  double deepest_m_ = 0.0;
  bool touched_ = false;
};

class BothPlants : public ::testing::TestWithParam<PlantKind> {
 protected:
  bool is_ode() const { return GetParam() == PlantKind::ode; }
  /// At 8 m/s ODE's vehicle moves 8 mm in the step in which it meets something.
  double allowed_m() const { return is_ode() ? 0.02 : 1e-5; }
};

INSTANTIATE_TEST_SUITE_P(Of, BothPlants, ::testing::Values(PlantKind::kinematic, PlantKind::ode),
                         [](const auto& info) {
                           return info.param == PlantKind::ode ? "ode" : "kinematic";
                         });

TEST_P(BothPlants, AnObstacleStopsItNoseOnAndBothWheelsSlip) {
  for (const Obstacle& obstacle : {box_obstacle(10.0, 0.0), cylinder(10.0, 0.0, 0.5)}) {
    for (const double v_mps : {1.0, 4.0, 8.0}) {
      Driven vehicle(GetParam(), hall({obstacle}));
      vehicle.drive(wheels(v_mps, 0.0), 15.0);
      EXPECT_TRUE(vehicle.state().wall_contact);
      EXPECT_NEAR(vehicle.state().pose.x_m, 9.5 - 1.5, is_ode() ? 2e-3 : 1e-6);
      EXPECT_NEAR(vehicle.state().twist.v_mps, 0.0, 0.01);
      EXPECT_LT(vehicle.deepest_m(), allowed_m());
      EXPECT_NEAR(vehicle.state().rim_speeds.left_mps, v_mps, 0.01);
    }
  }
}

TEST_P(BothPlants, ItTouchesWithItsWheelsToo) {
  // The chassis is 1 m wide, the wheels reach to 0.7 m: they alone meet what is at 0.6 m.
  for (const Obstacle& obstacle : {box_obstacle(5.0, 1.1), cylinder(5.0, 0.85, 0.25)}) {
    Driven vehicle(GetParam(), hall({obstacle}));
    vehicle.drive(wheels(1.0, 0.0), 6.0);
    EXPECT_TRUE(vehicle.touched());
    EXPECT_LT(vehicle.deepest_m(), allowed_m());
    Driven past(GetParam(), hall({box_obstacle(5.0, 1.21), cylinder(7.0, -1.0, 0.25)}));
    past.drive(wheels(1.0, 0.0), 6.0);
    EXPECT_FALSE(past.touched());
    EXPECT_GT(past.state().pose.x_m, 5.0);
  }
}

TEST_P(BothPlants, ItBacksOffAgain) {
  Driven vehicle(GetParam(), hall({box_obstacle(6.0, 0.0)}));
  vehicle.drive(wheels(4.0, 0.0), 5.0);
  EXPECT_TRUE(vehicle.state().wall_contact);
  vehicle.drive(wheels(-1.0, 0.0), 6.0);
  EXPECT_FALSE(vehicle.state().wall_contact);
  EXPECT_LT(vehicle.state().pose.x_m, 1.0);
}

TEST_P(BothPlants, StaysOutOfObstaclesWhateverTheCommand) {
  RandomEngine random = random_stream(1, "drives");
  const auto draw = [&](double low, double high) {
    return low + (high - low) * uniform_01(random);
  };
  for (int run = 0; run < 5; ++run) {
    std::vector<Obstacle> obstacles;
    while (obstacles.size() < 25) {
      const double x = draw(-21, 21), y = draw(-21, 21);
      if (std::hypot(x, y) < 4.0) continue;
      obstacles.push_back(obstacles.size() % 3 == 0
                              ? cylinder(x, y, draw(0.05, 0.7))
                              : box_obstacle(x, y, draw(0.1, 6.0), draw(0.1, 2.0), draw(-4, 4)));
    }
    Driven vehicle(GetParam(), hall(obstacles), {0.0, 0.0, draw(-3, 3)});
    for (int i = 0; i < 20; ++i) vehicle.drive(wheels(draw(-3, 5), draw(-1, 1)), 1.0);
    EXPECT_LT(vehicle.deepest_m(), is_ode() ? 0.03 : 2e-3) << run;
    EXPECT_TRUE(std::isfinite(vehicle.state().pose.x_m));
    EXPECT_LT(std::abs(vehicle.state().roll_rad), 0.5) << run;
  }
}

TEST_P(BothPlants, AWallOfObstaclesIsAsTheHallsWall) {
  // The same run ends at the same place: wall obstacles may hold the box's corners, not the upright
  // edges.
  const Pose2 start{10.0, 0.0, 0.5};
  Driven at_wall(GetParam(), {}, start);
  Driven at_obstacle(GetParam(),
                     hall({{.kind = Obstacle::Kind::wall,
                            .pose = {22.1, 0.0, std::numbers::pi / 2.0},
                            .length_m = 80.0,
                            .width_m = 0.2}}),
                     start, {.half_extent_m = 40.0});
  for (Driven* vehicle : {&at_wall, &at_obstacle}) {
    vehicle->drive(wheels(2.0, 0.0), 8.0);
    EXPECT_TRUE(vehicle->touched());
  }
  const VehicleState a = at_wall.state(), b = at_obstacle.state();
  EXPECT_NEAR(a.pose.x_m, b.pose.x_m, is_ode() ? 0.02 : 1e-6);
  EXPECT_NEAR(a.pose.y_m, b.pose.y_m, is_ode() ? 0.4 : 1e-6);
  EXPECT_NEAR(a.pose.yaw_rad, b.pose.yaw_rad, is_ode() ? 0.05 : 1e-6);
}

TEST_P(BothPlants, WhatMovesPushesAVehicleThatStands) {
  for (const Obstacle& obstacle : {box_obstacle(-5.0, 0.0), cylinder(-5.0, 0.0, 0.4)}) {
    Driven vehicle(GetParam(), hall({going(obstacle, {{5.0, 0.0}}, 1.2)}));
    vehicle.drive({}, 8.0);
    const double back_m = obstacle.kind == Obstacle::Kind::box ? 0.5 : 0.4;
    EXPECT_TRUE(vehicle.touched());
    EXPECT_NEAR(vehicle.state().pose.x_m, -5.0 + 8.0 * 1.2 + back_m + 0.5, 0.05);
    EXPECT_LT(vehicle.deepest_m(), is_ode() ? 0.02 : 2e-3);
  }
}

TEST_P(BothPlants, IsFreeAgainWhenWhatHeldItLeaves) {
  Driven vehicle(GetParam(), hall({going(box_obstacle(6.0, 0.0), {{14.0, 0.0}}, 0.3)}));
  vehicle.drive(wheels(2.0, 0.0), 6.0);
  EXPECT_TRUE(vehicle.touched());
  EXPECT_NEAR(vehicle.state().twist.v_mps, 0.3, 0.01) << "no faster than what is in front";
  vehicle.drive(wheels(0.1, 0.0), 4.0);
  EXPECT_FALSE(vehicle.state().wall_contact);
  EXPECT_NEAR(vehicle.state().twist.v_mps, 0.1, 0.01);
}

TEST_P(BothPlants, BetweenWhatMovesAndAWallNothingBreaks) {
  const std::vector<Obstacle> obstacles{
      going(box_obstacle(10.0, 0.0, 1.0, 3.0), {{21.4, 0.0}}, 1.0),
      going(cylinder(20.0, 10.0, 0.3), {{20.0, -10.0}}, 1.5)};
  Driven vehicle(GetParam(), hall(obstacles), {18.0, 0.0, 0.2});
  vehicle.drive(wheels(0.5, 0.0), 40.0);
  const VehicleState s = vehicle.state();
  EXPECT_TRUE(vehicle.touched());
  EXPECT_TRUE(std::isfinite(s.pose.x_m) && std::isfinite(s.pose.y_m));
  EXPECT_LT(std::abs(s.pose.x_m), 22.5);
  EXPECT_LT(std::abs(s.pose.y_m), 22.5);
}

TEST_P(BothPlants, OfEqualInputsTheStatesAreEqualToTheBit) {
  const std::vector<Obstacle> obstacles{going(cylinder(4.0, -3.0, 0.3), {{4.0, 3.0}}, 1.0),
                                        box_obstacle(9.0, 1.0, 2.0, 2.0, 0.3)};
  std::array<VehicleState, 2> ends;
  for (VehicleState& end : ends) {
    Driven vehicle(GetParam(), hall(obstacles));
    vehicle.drive(wheels(2.0, 0.1), 5.0);
    vehicle.drive(wheels(-1.0, 0.5), 5.0);
    end = vehicle.state();
  }
  EXPECT_EQ(ends[0].pose.x_m, ends[1].pose.x_m);
  EXPECT_EQ(ends[0].pose.yaw_rad, ends[1].pose.yaw_rad);
}

TEST_P(BothPlants, FarObstaclesChangeNothing) {
  Driven alone(GetParam(), {}),
      among(GetParam(), hall({box_obstacle(18.0, 18.0), box_obstacle(-9.0, 5.0)}));
  for (Driven* vehicle : {&alone, &among}) {
    vehicle->drive(wheels(1.0, 0.3), 5.0);
    vehicle->drive(wheels(1.0, -0.4), 5.0);
  }
  EXPECT_FALSE(among.touched());
  EXPECT_EQ(alone.state().pose.x_m, among.state().pose.x_m);
  EXPECT_EQ(alone.state().pose.yaw_rad, among.state().pose.yaw_rad);
}

TEST_P(BothPlants, AScanOfPostsUnderARackIsStillAWholeBoxToTouch) {
  Driven vehicle(GetParam(), hall({{.kind = Obstacle::Kind::rack,
                                    .pose = {8.0, 0.0, std::numbers::pi / 2.0},
                                    .length_m = 8.4,
                                    .width_m = 1.0,
                                    .height_m = 4.0}}));
  vehicle.drive(wheels(1.0, 0.0), 10.0);
  EXPECT_NEAR(vehicle.state().pose.x_m, 7.5 - 1.5, 2e-3);
}

}  // namespace
}  // namespace tether
