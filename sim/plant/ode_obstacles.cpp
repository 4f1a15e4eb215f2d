#include "sim/plant/ode_obstacles.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tether {
namespace {

constexpr int kMostPoints = 4;  ///< contact points of two geoms
/// A contact that is steeper has no horizontal direction to speak of.
constexpr double kLevel = 0.1;

/// Moving shapes push at their own speed, and drag along by friction.
void add_motion(dContact& contact, const Shape& shape) {
  const dReal* n = contact.geom.normal;
  const double level = std::hypot(n[0], n[1]);
  if ((shape.vx_mps == 0.0 && shape.vy_mps == 0.0) || level < kLevel) return;
  const double tangent[2] = {-n[1] / level, n[0] / level};
  contact.surface.mode |= dContactFDir1 | dContactMotion1 | dContactMotionN;
  std::copy_n(tangent, 2, contact.fdir1);
  contact.surface.motion1 = shape.vx_mps * tangent[0] + shape.vy_mps * tangent[1];
  contact.surface.motionN = shape.vx_mps * n[0] + shape.vy_mps * n[1];
}

}  // namespace

OdeObstacles::OdeObstacles(const VehicleConfig& vehicle, dBodyID chassis,
                           const std::array<double, 3>& box_centre_m,
                           const std::array<dBodyID, 2>& wheels, double friction)
    : friction_(friction),
      box_(dCreateBox(nullptr, 1.0, 1.0, 1.0)),
      cylinder_(dCreateCylinder(nullptr, 1.0, 1.0)) {
  vehicle_[0] = dCreateBox(nullptr, vehicle.chassis_length_m, vehicle.chassis_width_m,
                           vehicle.chassis_height_m);
  dGeomSetBody(vehicle_[0], chassis);
  dGeomSetOffsetPosition(vehicle_[0], box_centre_m[0], box_centre_m[1], box_centre_m[2]);
  dMatrix3 on_its_rim;  // ODE's cylinders stand upright
  dRFromAxisAndAngle(on_its_rim, 1, 0, 0, std::numbers::pi / 2.0);
  for (std::size_t i = 0; i < wheels.size(); ++i) {
    vehicle_[i + 1] = dCreateCylinder(nullptr, vehicle.wheel_radius_m, vehicle.wheel_width_m);
    dGeomSetBody(vehicle_[i + 1], wheels[i]);
    dGeomSetOffsetRotation(vehicle_[i + 1], on_its_rim);
  }
}

OdeObstacles::~OdeObstacles() {
  for (const dGeomID geom : vehicle_) dGeomDestroy(geom);
  dGeomDestroy(box_);
  dGeomDestroy(cylinder_);
}

dGeomID OdeObstacles::place(const Shape& shape) {
  const bool round = shape.outline == Shape::Outline::circle;
  const dGeomID geom = round ? cylinder_ : box_;
  if (round) {
    dGeomCylinderSetParams(geom, shape.radius_m, shape.height_m);
  } else {
    dGeomBoxSetLengths(geom, shape.length_m, shape.width_m, shape.height_m);
  }
  dGeomSetPosition(geom, shape.pose.x_m, shape.pose.y_m, 0.5 * shape.height_m);
  dMatrix3 turned;
  dRFromAxisAndAngle(turned, 0, 0, 1, shape.pose.yaw_rad);
  dGeomSetRotation(geom, turned);
  return geom;
}

bool OdeObstacles::add_contacts(dWorldID world, dJointGroupID contacts,
                                std::span<const Shape> near) {
  bool touches = false;
  for (const Shape& shape : near) {
    const dGeomID obstacle = place(shape);
    for (const dGeomID part : vehicle_) {
      std::array<dContactGeom, kMostPoints> points;
      const int count = dCollide(part, obstacle, kMostPoints, points.data(), sizeof(dContactGeom));
      for (int i = 0; i < count; ++i) {
        dContact contact{};
        contact.surface.mode = dContactApprox1;
        contact.surface.mu = friction_;
        contact.geom = points[static_cast<std::size_t>(i)];
        add_motion(contact, shape);
        dJointAttach(dJointCreateContact(world, contacts, &contact), dGeomGetBody(part), nullptr);
        touches = true;
      }
    }
  }
  return touches;
}

}  // namespace tether
