#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "common/base/random.hpp"
#include "common/scenario/section.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// One [[world.obstacle]]. Its keys and their ranges are in obstacle_list.cpp.
struct Obstacle {
  enum class Kind { box, cylinder, wall, rack };
  Kind kind = Kind::box;
  Pose2 pose = {};         ///< pose of its centre, at t = 0
  double length_m = 1.0;   ///< box, wall, rack
  double width_m = 1.0;    ///< box, rack; a wall's thickness
  double radius_m = 0.25;  ///< cylinder
  double height_m = 2.0;   ///< height of its top above the floor
  double reflectivity = 0.5;
  bool mapped = true;  ///< in the map that localisers have; moving ones never are

  /// A box or a cylinder goes through these places and back to its first one, again and again, in
  /// straight lines; a box does not turn. Empty: it stands.
  std::vector<Position> to = {};
  double speed_mps = 1.0;        ///< mean
  double speed_variation = 0.2;  ///< from place to place: even within speed_mps · (1 ± this)
  double pause_s = 2.0;          ///< mean of the pauses at all places, exponential

  bool moves() const { return !to.empty(); }
};

/// Objects in the hall, without its four walls: [[world.obstacle]], and the occupancy map of
/// [map].
struct Surroundings {
  std::string map_file;  ///< map.file: of an occupancy map, YAML; "": none
  std::vector<Obstacle> obstacles;
  /// For a fleet's vehicle: the others are no faster; 0: there are none. Not a key.
  double vehicles_mps = 0.0;

  bool any() const { return !map_file.empty() || !obstacles.empty() || vehicles_mps > 0.0; }
};

/// It refuses what is beyond the hall or stands where the vehicle starts, and paths that lead
/// through what the map shows. What the map does not show may block a path.
ScenarioSection surroundings_section();

using HallSettings = Sections<WorldSettings, Surroundings>;

/// A rack is its posts, a pair every kRackBay_m, and a shelf upon them, which begins at this
/// height: scanners below it see the posts only. Vehicles do not fit under it.
inline constexpr double kShelfClearance_m = 0.4;
inline constexpr double kRackBay_m = 2.8;  ///< at most; three pallets side by side
inline constexpr double kRackPost_m = 0.1;

/// All that stands still: the four walls, obstacles, and the map's occupied cells. Throws
/// UsageError for what is wrong with the map's files.
std::vector<Shape> standing_shapes(const HallSettings& settings);
/// Shapes in the map that localisers and planners have.
std::vector<Shape> mapped_shapes(const HallSettings& settings);
/// All of them but the four walls.
std::vector<Shape> obstacle_shapes(const Surroundings& surroundings);
/// Shapes that vehicles can touch: racks are whole boxes.
std::vector<Shape> solid_shapes(const Surroundings& surroundings);

/// Obstacles that move by themselves: people, trolleys. Where each is depends on time, seed and its
/// own place in the scenario only, not on when it was asked before: random stream
/// "world/obstacle/<n>", n = 1 for the first [[world.obstacle]]. Each begins with a pause.
class MovingObstacles {
 public:
  MovingObstacles(const Surroundings& surroundings, std::uint64_t seed);
  MovingObstacles(const HallSettings& settings, std::uint64_t seed)
      : MovingObstacles(settings.get<Surroundings>(), seed) {}

  bool any() const { return !shapes_.empty(); }
  /// None is ever faster.
  double fastest_mps() const;
  /// Where they are at `t_s` since the run's start; before it, as at 0. Cheap for times that
  /// ascend.
  const std::vector<Shape>& at(double t_s);

 private:
  /// One of them, and the way that it is on: it pauses from begin_s on, and goes from depart_s on.
  struct Walker {
    Obstacle obstacle;
    RandomEngine seeded, random;
    std::size_t from = 0;  ///< place: 0 is its first one, i is to[i − 1]
    double begin_s = 0.0, depart_s = 0.0, arrive_s = 0.0;
    double vx_mps = 0.0, vy_mps = 0.0;

    Position place(std::size_t i) const;
    void plan();
    void seek(double t_s);
  };

  std::vector<Walker> walkers_;
  std::vector<Shape> shapes_;
};

/// The outline that an obstacle has at t = 0; of a rack, its shelf.
Shape shape_of(const Obstacle& obstacle);

}  // namespace tether
