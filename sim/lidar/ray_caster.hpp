#pragma once

#include <cstdint>
#include <vector>

#include "common/world/shape.hpp"
#include "sim/lidar/ray_fan.hpp"

namespace tether {

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
