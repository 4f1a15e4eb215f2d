#pragma once

#include <ode/ode.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "common/world/shape.hpp"
#include "sim/plant/ode_world.hpp"

namespace tether::test {

/// The same shapes as geoms of ODE in a quadtree, for its rays.
class OdeRays {
 public:
  OdeRays(const std::vector<Shape>& shapes, double height_m) : height_m_(height_m) {
    prepare_ode_thread();
    const dVector3 centre{0.0, 0.0, 0.0}, extents{100.0, 100.0, 10.0};
    space_ = dQuadTreeSpaceCreate(nullptr, centre, extents, 7);
    for (const Shape& shape : shapes) {
      const double tall_m = shape.height_m - shape.clearance_m;
      const bool circle = shape.outline == Shape::Outline::circle;
      dGeomID geom = circle ? dCreateCylinder(space_, shape.radius_m, tall_m)
                            : dCreateBox(space_, shape.length_m, shape.width_m, tall_m);
      dGeomSetPosition(geom, shape.pose.x_m, shape.pose.y_m, shape.clearance_m + 0.5 * tall_m);
      dMatrix3 rotation;
      dRFromAxisAndAngle(rotation, 0.0, 0.0, 1.0, shape.pose.yaw_rad);
      dGeomSetRotation(geom, rotation);
    }
    ray_ = dCreateRay(nullptr, 1.0);
    dGeomRaySetClosestHit(ray_, 1);
  }
  ~OdeRays() {
    dGeomDestroy(ray_);
    dSpaceDestroy(space_);
  }
  OdeRays(const OdeRays&) = delete;
  OdeRays& operator=(const OdeRays&) = delete;

  struct Hit {
    double range_m = std::numeric_limits<double>::infinity();
    double cos_incidence = 0.0;
  };
  Hit cast(double x_m, double y_m, double dx, double dy, double max_m) {
    dGeomRaySetLength(ray_, max_m);
    dGeomRaySet(ray_, x_m, y_m, height_m_, dx, dy, 0.0);
    Hit hit;
    dSpaceCollide2(ray_, reinterpret_cast<dGeomID>(space_), &hit,
                   [](void* out, dGeomID a, dGeomID b) {
                     dContactGeom contact;
                     if (dCollide(a, b, 1, &contact, sizeof contact) == 0) return;
                     Hit& nearest = *static_cast<Hit*>(out);
                     if (contact.depth >= nearest.range_m) return;
                     const dGeomID ray = dGeomGetClass(a) == dRayClass ? a : b;
                     dVector3 start, along;
                     dGeomRayGet(ray, start, along);
                     nearest.range_m = contact.depth;
                     nearest.cos_incidence =
                         std::abs(along[0] * contact.normal[0] + along[1] * contact.normal[1]);
                   });
    return hit;
  }

 private:
  double height_m_;
  dSpaceID space_;
  dGeomID ray_;
};

}  // namespace tether::test
