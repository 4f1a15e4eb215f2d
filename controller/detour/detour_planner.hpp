#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"
#include "controller/detour/smooth_way.hpp"

namespace tether {

/// How far it is from each place of a square of floor to what stands there: a grid of cells of
/// kCell_m, exact at their centres, up to kFar_m. Pure.
class FloorMap {
 public:
  static constexpr double kCell_m = 0.1;
  static constexpr double kFar_m = 1.0;

  /// A square of 2 · half_m around `centre`.
  FloorMap(const Position& centre, double half_m);

  void add(const Shape& shape);
  void add(const Position& point);

  /// From a place to the nearest thing, at most kFar_m; negative within one; −kFar_m beyond the
  /// square, for nothing is known there. Between cells' centres it is interpolated.
  double distance_m(const Position& p) const;

 private:
  template <class Distance>
  void lower(double x0, double y0, double x1, double y1, Distance distance);

  double x0_m_, y0_m_;  ///< the square's corner
  int side_;            ///< cells
  std::vector<float> distance_m_;
};

/// The rim of a rectangle around the vehicle, as points in its frame at most 0.2 m apart: what is
/// nowhere nearer to them than c is farther than about c from the rectangle.
std::vector<Position> rim(double rear_m, double front_m, double half_width_m);

/// How far all the points, in the frame of `pose`, are from what stands there.
double gap_m(const FloorMap& floor, const std::vector<Position>& points, const Pose2& pose);

/// Finds a way around what stands there, for a vehicle that can turn on the spot and drives
/// forward. Pure and deterministic; no more than kMostExpansions.
///
/// Hybrid A* (Dolgov, Thrun, Montemerlo, Diebel: Path planning for autonomous vehicles in unknown
/// semi-structured environments. Int. J. Robotics Research 29 (5), 2010): the poses are continuous,
/// one is kept for each cell of position and heading. From each lead five moves: straight, an arc
/// to either side, a turn on the spot to either side. The cost is the way's length, more near
/// obstacles, and what turns take. The estimate of what is left is the distance of the nearest
/// goal.
class DetourPlanner {
 public:
  static constexpr int kMostExpansions = 60'000;
  static constexpr int kHeadings = 24;

  struct Config {
    double rear_m = -0.5, front_m = 1.5, half_width_m = 0.7;
    double gap_m = 0.23;    ///< to keep all around the vehicle where it drives forward
    double ahead_m = 0.42;  ///< and ahead of its front
    double side_m = 0.15;   ///< beside it where it turns on the spot
  };

  explicit DetourPlanner(const Config& config);

  /// The way from `start` to within 0.2 m and half a step of heading of one of `goals`, as poses:
  /// each is the end of a move, turns on the spot keep the position. nullopt: there is none, or it
  /// was not found in kMostExpansions.
  std::optional<std::vector<Pose2>> plan(const FloorMap& floor, const Pose2& start,
                                         const std::vector<Pose2>& goals) const;

  /// Whether the vehicle may stand there, and may drive forward there.
  bool is_free(const FloorMap& floor, const Pose2& pose) const;

  Room room(const FloorMap& floor, const Pose2& pose) const;

  const Config& config() const { return config_; }
  int expansions() const { return expansions_; }  ///< expansions of the last plan

 private:
  struct Node {
    Pose2 pose;
    int heading;  ///< steps from the start's
    double cost;
    int from;
  };
  class Search;

  Config config_;
  std::vector<Position> outline_;  ///< its rim
  std::vector<Position> longer_;   ///< with what it needs ahead
  std::vector<Position> wider_;    ///< with what it needs beside it
  mutable int expansions_ = 0;
};

}  // namespace tether
