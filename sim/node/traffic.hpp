#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <set>
#include <utility>
#include <vector>

#include "common/base/time.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"
#include "sim/plant/plant.hpp"

namespace tether {

/// The vehicles of a fleet, as they meet. Each has a plant of its own; those that may touch within
/// the next kHorizon move step by step together, all others each for itself, as a vehicle that is
/// alone.
///
/// Where two touch, each is pushed by the other as by an obstacle that moves as both together do
/// after an inelastic impact: with the mean of their velocities by mass, as the step begins. So
/// momentum is kept between equal vehicles, and one that is pushed yields; that they turn does not
/// count for this velocity.
class Traffic {
 public:
  static constexpr Duration kHorizon = std::chrono::milliseconds{40};
  /// Two vehicles touch from here on, and have parted beyond the other.
  static constexpr double kTouching_m = 2e-3, kParted_m = 2e-2;

  /// `start`: from here on they move.
  explicit Traffic(Duration step, Instant start = kStart) : step_(step), looked_until_(start) {}
  Traffic(const Traffic&) = delete;
  Traffic& operator=(const Traffic&) = delete;

  /// Adds a vehicle at rest and returns its number, from 0 on. `move` makes its steps up to and
  /// including that which ends by the given time. `plant` must outlive this.
  std::size_t add(const VehicleConfig& vehicle, Plant& plant, std::function<void(Instant)> move);

  /// Moves a vehicle, and those that it may touch; before it is beyond what was looked at, all.
  void advance(std::size_t vehicle, Instant until);

  /// The other vehicles within `range_m` of where this one is at `now`, with their velocities.
  std::vector<Shape> seen_from(std::size_t vehicle, Instant now, double range_m);

  /// How often another vehicle has begun to touch this one.
  std::int64_t collisions(std::size_t vehicle) const { return vehicles_[vehicle].collisions; }

 private:
  struct Vehicle {
    std::function<void(Instant)> move;
    Plant* plant;
    /// With these it moves, itself among them; empty: alone.
    std::vector<std::size_t> cluster = {};
    double reach_m;   ///< reach of its outline, from the axle's midpoint
    double radius_m;  ///< the same from the chassis' centre
    double mass_kg;
    VehicleConfig config;
    std::vector<std::size_t> near = {};  ///< others that it may touch
    std::vector<Shape> touchable = {};   ///< shapes of others, in the step that begins
    std::int64_t collisions = 0;
  };
  void look();
  void move(std::size_t vehicle, Instant until);
  std::vector<std::pair<std::size_t, std::size_t>> near_pairs() const;
  void step(const std::vector<std::size_t>& cluster, Instant end);
  void meet(std::size_t a, std::size_t b);
  void note_contact(std::size_t a, std::size_t b, double gap_m);

  Duration step_;
  Instant looked_until_;  ///< who may touch whom is known until here
  std::vector<Vehicle> vehicles_;
  std::vector<Instant> times_;  ///< end of the last step of the vehicles that move together
  std::set<std::pair<std::size_t, std::size_t>> touching_;
};

}  // namespace tether
