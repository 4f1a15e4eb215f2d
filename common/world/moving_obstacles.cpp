#include <fmt/format.h>

#include <algorithm>
#include <boost/random/exponential_distribution.hpp>
#include <cmath>

#include "common/world/obstacle_shape.hpp"
#include "common/world/surroundings.hpp"

namespace tether {

Position MovingObstacles::Walker::place(std::size_t i) const {
  return i == 0 ? Position{obstacle.pose.x_m, obstacle.pose.y_m} : obstacle.to[i - 1];
}

/// The way from `from` on, which begins at begin_s.
void MovingObstacles::Walker::plan() {
  const Position a = place(from), b = place((from + 1) % (obstacle.to.size() + 1));
  const double pause_s =
      obstacle.pause_s * boost::random::exponential_distribution<double>()(random);
  const double share = 1.0 + obstacle.speed_variation * (2.0 * uniform_01(random) - 1.0);
  const double way_s = std::hypot(b.x_m - a.x_m, b.y_m - a.y_m) / (obstacle.speed_mps * share);
  depart_s = begin_s + pause_s;
  arrive_s = depart_s + way_s;
  vx_mps = (b.x_m - a.x_m) / way_s;
  vy_mps = (b.y_m - a.y_m) / way_s;
}

void MovingObstacles::Walker::seek(double t_s) {
  if (t_s < begin_s) {
    random = seeded;
    from = 0;
    begin_s = 0.0;
    plan();
  }
  while (t_s >= arrive_s) {
    from = (from + 1) % (obstacle.to.size() + 1);
    begin_s = arrive_s;
    plan();
  }
}

MovingObstacles::MovingObstacles(const Surroundings& surroundings, std::uint64_t seed) {
  for (std::size_t i = 0; i < surroundings.obstacles.size(); ++i) {
    const Obstacle& obstacle = surroundings.obstacles[i];
    if (!obstacle.moves()) continue;
    const RandomEngine random = random_stream(seed, fmt::format("world/obstacle/{}", i + 1));
    walkers_.push_back({.obstacle = obstacle, .seeded = random, .random = random});
    walkers_.back().plan();
    shapes_.push_back(shape_of(obstacle));
  }
}

double MovingObstacles::fastest_mps() const {
  double fastest = 0.0;
  for (const Walker& w : walkers_) {
    fastest = std::max(fastest, w.obstacle.speed_mps * (1.0 + w.obstacle.speed_variation));
  }
  return fastest;
}

const std::vector<Shape>& MovingObstacles::at(double t_s) {
  const double now_s = std::max(0.0, t_s);
  for (std::size_t i = 0; i < walkers_.size(); ++i) {
    Walker& w = walkers_[i];
    w.seek(now_s);
    Shape& shape = shapes_[i];
    const bool goes = now_s >= w.depart_s;
    const double way_s = goes ? now_s - w.depart_s : 0.0;
    const Position from = w.place(w.from);
    shape.pose.x_m = from.x_m + w.vx_mps * way_s;
    shape.pose.y_m = from.y_m + w.vy_mps * way_s;
    shape.vx_mps = goes ? w.vx_mps : 0.0;
    shape.vy_mps = goes ? w.vy_mps : 0.0;
  }
  return shapes_;
}

}  // namespace tether
