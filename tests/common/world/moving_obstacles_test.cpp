#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "common/world/surroundings.hpp"

namespace tether {
namespace {

Obstacle walker(double x_m, double y_m, std::vector<Position> to) {
  Obstacle o;
  o.kind = Obstacle::Kind::cylinder;
  o.pose = {x_m, y_m, 0.0};
  o.to = std::move(to);
  o.mapped = false;
  return o;
}

MovingObstacles moving(std::vector<Obstacle> obstacles, std::uint64_t seed = 1) {
  return {Surroundings{.map_file = "", .obstacles = std::move(obstacles)}, seed};
}

const Shape& only(MovingObstacles& m, double t_s) { return m.at(t_s).at(0); }

TEST(MovingObstacles, WhatStandsIsNotAmongThem) {
  Obstacle standing;
  EXPECT_FALSE(moving({standing}).any());
  EXPECT_TRUE(moving({standing, walker(0, 0, {{1, 0}})}).any());
}

TEST(MovingObstacles, WithoutVariationAndPausesTheWayIsKnown) {
  Obstacle o = walker(0, 0, {{4, 0}, {4, 3}});  // and 5 m back
  o.speed_mps = 2.0;
  o.speed_variation = 0.0;
  o.pause_s = 0.0;
  auto m = moving({o});
  EXPECT_NEAR(only(m, 1.0).pose.x_m, 2.0, 1e-12);
  EXPECT_NEAR(only(m, 1.0).vx_mps, 2.0, 1e-12);
  EXPECT_NEAR(only(m, 3.0).pose.y_m, 2.0, 1e-12);
  EXPECT_NEAR(only(m, 3.0).vy_mps, 2.0, 1e-12);
  EXPECT_NEAR(only(m, 4.75).pose.x_m, 2.0, 1e-12);
  EXPECT_NEAR(only(m, 6.0).pose.x_m, 0.0, 1e-12) << "and round again";
  EXPECT_NEAR(only(m, 601.0).pose.x_m, 2.0, 1e-9);
  EXPECT_EQ(m.fastest_mps(), 2.0);
}

TEST(MovingObstacles, StandWhereTheyBeginBeforeTheRun) {
  auto m = moving({walker(1, 2, {{5, 2}})});
  EXPECT_EQ(only(m, -3.0).pose.x_m, 1.0);
  EXPECT_EQ(only(m, -3.0).vx_mps, 0.0);
}

TEST(MovingObstacles, DependOnTheTimeAloneNotOnWhatWasAskedBefore) {
  const std::vector<Obstacle> obstacles{walker(0, 0, {{4, 0}, {4, 3}}), walker(5, 5, {{-5, 5}})};
  auto ascending = moving(obstacles), jumping = moving(obstacles);
  std::vector<std::vector<Shape>> seen;
  for (int i = 0; i < 2000; ++i) seen.push_back(ascending.at(0.1 * i));
  RandomEngine random = random_stream(1, "times");
  for (int k = 0; k < 500; ++k) {
    const auto i = static_cast<std::size_t>(2000.0 * uniform_01(random));
    const auto& at = jumping.at(0.1 * static_cast<double>(i));
    for (std::size_t n = 0; n < at.size(); ++n) {
      EXPECT_EQ(at[n].pose.x_m, seen[i][n].pose.x_m);
      EXPECT_EQ(at[n].pose.y_m, seen[i][n].pose.y_m);
      EXPECT_EQ(at[n].vx_mps, seen[i][n].vx_mps);
    }
  }
}

TEST(MovingObstacles, HaveTheirOwnLuckWhateverElseMovesOrStands) {
  auto alone = moving({Obstacle{}, walker(0, 0, {{4, 0}})});
  auto among = moving({walker(9, 9, {{8, 9}}), walker(0, 0, {{4, 0}}), walker(7, 7, {{6, 7}})});
  auto elsewhere = moving({walker(0, 0, {{4, 0}})});
  auto reseeded = moving({Obstacle{}, walker(0, 0, {{4, 0}})}, 2);
  double apart_m = 0.0, reseeded_m = 0.0;
  for (double t_s = 0.0; t_s < 60.0; t_s += 0.5) {
    const double x_m = only(alone, t_s).pose.x_m;
    EXPECT_EQ(x_m, among.at(t_s)[1].pose.x_m);
    apart_m = std::max(apart_m, std::abs(x_m - only(elsewhere, t_s).pose.x_m));
    reseeded_m = std::max(reseeded_m, std::abs(x_m - only(reseeded, t_s).pose.x_m));
  }
  EXPECT_GT(apart_m, 1.0) << "its place in the list is part of its luck";
  EXPECT_GT(reseeded_m, 1.0);
}

TEST(MovingObstacles, NeverJumpAndMoveAsTheySay) {
  auto m = moving({walker(0, 0, {{4, 0}, {4, 3}})});
  Shape last = only(m, 0.0);
  for (int i = 1; i < 100'000; ++i) {
    const Shape now = only(m, 1e-3 * i);
    EXPECT_LE(std::hypot(now.pose.x_m - last.pose.x_m, now.pose.y_m - last.pose.y_m),
              1e-3 * m.fastest_mps() + 1e-12);
    if (now.vx_mps == last.vx_mps && now.vy_mps == last.vy_mps) {
      EXPECT_NEAR(now.pose.x_m - last.pose.x_m, 1e-3 * last.vx_mps, 1e-9);
      EXPECT_NEAR(now.pose.y_m - last.pose.y_m, 1e-3 * last.vy_mps, 1e-9);
    }
    last = now;
  }
}

TEST(MovingObstacles, PauseAndGoAsLongAsConfiguredOnAverage) {
  Obstacle o = walker(0, 0, {{2, 0}});
  o.speed_mps = 1.0;
  o.speed_variation = 0.2;
  o.pause_s = 2.0;
  // A way takes 2 s / (1 + 0.2 u), u even in [−1, 1]: on average 2 atanh(0.2)/0.2 = 2.027 s. Of n
  // ways and pauses, the share of time that it stands has a standard deviation of about
  // (2.027 · 2)/(4.027)² / √n, the pauses' alone.
  const double way_s = 2.0 * std::atanh(0.2) / 0.2, n = 20'000.0;
  auto m = moving({o});
  double standing_s = 0.0;
  const double step_s = 0.05, end_s = n * (way_s + 2.0);
  for (double t_s = 0.0; t_s < end_s; t_s += step_s) {
    if (only(m, t_s).vx_mps == 0.0) standing_s += step_s;
  }
  const double sd = 2.0 * way_s / ((2.0 + way_s) * (2.0 + way_s)) / std::sqrt(n);
  EXPECT_NEAR(standing_s / end_s, 2.0 / (2.0 + way_s), 4.0 * sd);
}

}  // namespace
}  // namespace tether
