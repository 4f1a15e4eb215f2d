#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "common/path/reference_path.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// Rays that leave nearly one point one after another, each somewhat to the left of the one before,
/// by nearly equal angles: those of a scanner that moves meanwhile. Reusing one allocates nothing.
class RayFan {
 public:
  static constexpr double kNothing = std::numeric_limits<double>::infinity();
  static constexpr std::int64_t kNoShape = -1;

  void clear();
  /// `angle_rad`: of its direction, world frame, not wrapped. `time_s`: after the instant for which
  /// moving shapes are given.
  void add(const Position& from, double angle_rad, double time_s);

  std::size_t size() const { return x_m.size(); }

  // By ray.
  std::vector<double> x_m, y_m;  ///< where it begins
  std::vector<double> dx, dy;    ///< unit vector along it
  std::vector<double> angle_rad;
  std::vector<double> time_s;
  // Results of RayCaster.
  std::vector<double> range_m;      ///< range of the first surface; kNothing: none
  std::vector<std::int64_t> shape;  ///< which that is of, for RayCaster::hit(), or kNoShape

  std::vector<double> seen_x_m, seen_y_m;  ///< where it begins, as who moves sees it
};

inline void RayFan::clear() {
  for (auto* values : {&x_m, &y_m, &dx, &dy, &angle_rad, &time_s, &range_m, &seen_x_m, &seen_y_m}) {
    values->clear();
  }
  shape.clear();
}

inline void RayFan::add(const Position& from, double angle, double time) {
  x_m.push_back(from.x_m);
  y_m.push_back(from.y_m);
  dx.push_back(std::cos(angle));
  dy.push_back(std::sin(angle));
  angle_rad.push_back(angle);
  time_s.push_back(time);
  range_m.push_back(kNothing);
  shape.push_back(kNoShape);
  seen_x_m.push_back(0.0);
  seen_y_m.push_back(0.0);
}

/// How a ray meets a surface.
struct RayHit {
  /// Cosine of the angle between the ray and the surface's normal, 0 … 1.
  double cos_incidence = 1.0;
  double reflectivity = 0.0;  ///< reflectivity of the shape
};

/// Casts fans of rays in the plane at a height, against the outlines of the shapes that this height
/// cuts; from within a shape against its outline as well, but not against what stands within
/// another, if that is 0.4 m wide, as a rack's posts in its shelf.
///
/// The shapes are drawn into the fan one by one, as a renderer with a depth buffer does, instead of
/// sending ray by ray through a grid: from where the scanner is, a shape covers an interval of
/// directions, and only the rays of that interval are cut with it, each exactly, from its own
/// origin. In a hall of 60 shapes that is three cuts a ray. So a scan costs some 50 ns a shape and
/// 5 ns a cut. The order of shapes changes nothing but which of two at the same range is named.
class RayCaster {
 public:
  /// The shapes that stand: their velocities do not count.
  RayCaster(const std::vector<Shape>& standing, double height_m);

  /// The shapes that move from now on, where they are at time 0 of the fans.
  void set_moving(const std::vector<Shape>& shapes);

  /// Sets range_m and shape of each ray to those of the first surface within `max_m`.
  void cast(RayFan& fan, double max_m) const;

  /// Hit of a ray of a fan that was cast and met a shape.
  RayHit hit(const RayFan& fan, std::size_t ray) const;

 private:
  /// A shape, ready to be cut: a rectangle of half_length_m by half_width_m, turned by (c, s), or,
  /// if half_width_m is 0, a circle of radius half_length_m.
  struct Outline {
    double x_m, y_m;
    double c, s;
    double half_length_m, half_width_m;
    double reach_m;  ///< no part is farther from the centre
    double reflectivity;
    double vx_mps, vy_mps;

    bool is_circle() const { return half_width_m == 0.0; }
    bool is_within(const Outline& larger) const;
  };
  class View;

  std::vector<Outline> outlines_of(const std::vector<Shape>& shapes) const;

  double height_m_;
  std::vector<Outline> standing_, moving_;
};

}  // namespace tether
