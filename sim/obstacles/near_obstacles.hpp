#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/vehicle/vehicle_config.hpp"
#include "common/world/surroundings.hpp"

namespace tether {

/// Which obstacles the vehicle can touch in its next step: mostly none, and then that costs little.
///
/// Obstacles that stand are kept by cells of a grid. What is near is looked for only when the
/// vehicle, or what moves, may have used up the gap that there was when it was last looked for: no
/// point of the vehicle moves farther than its axle does, and its reach times its turn.
class NearObstacles {
 public:
  /// Near is what the vehicle's outline comes to within `slack_m` in a step of `step_s` in which
  /// both move as fast as they can. `seed`: the run's.
  NearObstacles(const VehicleConfig& vehicle, const WorldSettings& world,
                const Surroundings& surroundings, std::uint64_t seed, double step_s,
                double slack_m);

  /// Other vehicles that may be near in the next steps, where they are at the next one's begin.
  /// Empty: none is. They are looked at then.
  void set_vehicles(std::span<const Shape> vehicles) { vehicles_ = vehicles; }

  bool any() const { return !standing_.empty() || any_moves(); }
  bool any_moves() const { return moving_.any() || !vehicles_.empty(); }
  double fastest_mps() const { return fastest_mps_; }

  /// Obstacles near the vehicle with its axle's midpoint at `axle`, at their places at `t_s`. Valid
  /// until the next call.
  std::span<const Shape> near(const Pose2& axle, double t_s) {
    if (vehicles_.empty() && is_still_clear(axle, t_s)) return {};
    look(axle, t_s);
    return near_;
  }

 private:
  bool is_still_clear(const Pose2& axle, double t_s) const;
  void look(const Pose2& axle, double t_s);
  void consider(const Shape& shape, const Footprint& outline, const Pose2& axle);
  void fill_cells();
  std::size_t cell_of(double place_m) const;

  VehicleConfig vehicle_;
  double half_extent_m_;
  std::vector<Shape> standing_;
  MovingObstacles moving_;
  std::span<const Shape> vehicles_;
  double fastest_mps_;
  double reach_m_;         ///< reach of the vehicle's outline, from its axle's midpoint
  double margin_m_ = 0.0;  ///< nearer is near

  std::size_t cells_a_side_ = 1;
  double cell_m_ = 0.0;
  std::vector<std::vector<std::uint32_t>> cells_;  ///< indices in standing_

  std::vector<Shape> near_;
  // When it was last looked for, and how far from all margins the vehicle was.
  Pose2 axle_;
  double t_s_ = 0.0;
  double clear_m_ = 0.0;
};

}  // namespace tether
