#pragma once

#include "common/world/shape.hpp"

namespace tether::test {

inline Shape box(double x_m, double y_m, double length_m, double width_m, double yaw_rad = 0.0) {
  Shape shape;
  shape.pose = {x_m, y_m, yaw_rad};
  shape.length_m = length_m;
  shape.width_m = width_m;
  return shape;
}

inline Shape cylinder(double x_m, double y_m, double radius_m) {
  Shape shape;
  shape.outline = Shape::Outline::circle;
  shape.pose = {x_m, y_m, 0.0};
  shape.radius_m = radius_m;
  return shape;
}

}  // namespace tether::test
