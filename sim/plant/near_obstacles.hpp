#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"
#include "common/world/surroundings.hpp"

namespace tether {

/// How two shapes press on each other, or would if they came nearer.
class Touch {
 public:
  struct Point {
    Position at;         ///< world frame
    double gap_m = 0.0;  ///< there, along the normal
  };

  Touch(const Position& normal, double gap_m) : normal_(normal), gap_m_(gap_m) {}
  void add(const Point& point) { points_[count_++] = point; }

  /// Unit vector from the first shape into the second, world frame.
  const Position& normal() const { return normal_; }
  /// Along the normal; negative: so far one must move to come free.
  double gap_m() const { return gap_m_; }
  /// At least one; two where a side lies on a side.
  std::span<const Point> points() const { return {points_.data(), count_}; }

 private:
  Position normal_;
  double gap_m_;
  std::array<Point, 2> points_{};
  std::size_t count_ = 0;
};

/// How a rectangle touches another shape. The normal is that of the side, of either rectangle, that
/// parts them most, as separating axes have it; of a circle, that through its centre. So a gap is
/// right where a side is nearest, and up to √2 too small between corners. The points are the ends
/// of what the sides have in common (as in Box2D's manifolds: E. Catto, Contact Manifolds, Game
/// Developers Conference 2007).
Touch touch(const Shape& rectangle, const Shape& other);

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
