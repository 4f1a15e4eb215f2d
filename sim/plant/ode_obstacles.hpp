#pragma once

#include <ode/ode.h>

#include <array>
#include <span>

#include "common/vehicle/vehicle_config.hpp"
#include "common/world/shape.hpp"

namespace tether {

/// How the vehicle's bodies touch obstacles: by ODE's own colliders, the chassis as a box and each
/// wheel as a cylinder, obstacles as boxes and upright cylinders that reach from the floor to their
/// height, without bodies: nothing moves them. What moves carries its velocity into the contact.
class OdeObstacles {
 public:
  /// `box_centre_m`: the chassis box's centre in the frame of its body.
  OdeObstacles(const VehicleConfig& vehicle, dBodyID chassis,
               const std::array<double, 3>& box_centre_m, const std::array<dBodyID, 2>& wheels,
               double friction);
  ~OdeObstacles();
  OdeObstacles(const OdeObstacles&) = delete;
  OdeObstacles& operator=(const OdeObstacles&) = delete;

  /// Adds the contacts with what is near to `contacts`; true if there are any.
  bool add_contacts(dWorldID world, dJointGroupID contacts, std::span<const Shape> near);

 private:
  dGeomID place(const Shape& shape);

  double friction_;
  std::array<dGeomID, 3> vehicle_{};  ///< chassis and wheels
  dGeomID box_, cylinder_;            ///< the obstacle that is being looked at
};

}  // namespace tether
