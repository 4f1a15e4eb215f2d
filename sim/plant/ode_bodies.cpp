// The part of OdeWorld that builds its bodies.
#include <algorithm>
#include <cmath>

#include "sim/plant/ode_world.hpp"

namespace tether {
namespace {

std::array<double, 3> operator-(const std::array<double, 3>& a, const std::array<double, 3>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

double norm(const std::array<double, 3>& a) { return std::hypot(a[0], a[1], a[2]); }

}  // namespace

void OdeWorld::build_chassis(const VehicleConfig& vehicle) {
  // In the frame of the box's centre first; ODE wants the body's origin at its centre of mass.
  dMass mass;
  dMassSetBoxTotal(&mass, vehicle.chassis_mass_kg, vehicle.chassis_length_m,
                   vehicle.chassis_width_m, vehicle.chassis_height_m);
  const std::array<double, 3> caster{
      vehicle.caster_x_m, 0.0,
      vehicle.caster_radius_m - vehicle.wheel_radius_m - vehicle.chassis_z_m};
  if (vehicle.caster_mass_kg > 0.0) {
    dMass ball;
    dMassSetSphereTotal(&ball, vehicle.caster_mass_kg, vehicle.caster_radius_m);
    dMassTranslate(&ball, caster[0], caster[1], caster[2]);
    dMassAdd(&mass, &ball);
  }
  if (vehicle.payload_kg > 0.0) {
    dMass payload;
    dMassSetSphereTotal(&payload, vehicle.payload_kg, kPayloadRadius_m);
    dMassTranslate(&payload, vehicle.payload_x_m, vehicle.payload_y_m, vehicle.payload_z_m);
    dMassAdd(&mass, &payload);
  }
  const std::array<double, 3> centre{mass.c[0], mass.c[1], mass.c[2]};
  dMassTranslate(&mass, -mass.c[0], -mass.c[1], -mass.c[2]);

  axle_in_chassis_m_ =
      std::array<double, 3>{vehicle.axle_x_m, 0.0, 0.0 - vehicle.chassis_z_m} - centre;
  caster_in_chassis_m_ = caster - centre;
  box_in_chassis_m_ = std::array<double, 3>{} - centre;
  for (std::size_t i = 0; i < corners_m_.size(); ++i) {
    const std::array<double, 3> corner{(i & 1 ? 0.5 : -0.5) * vehicle.chassis_length_m,
                                       (i & 2 ? 0.5 : -0.5) * vehicle.chassis_width_m,
                                       (i & 4 ? 0.5 : -0.5) * vehicle.chassis_height_m};
    corners_m_[i] = corner - centre;
    reach_m_ = std::max(reach_m_, norm(corners_m_[i]));
  }

  dBodyID chassis = bodies_[kChassis] = dBodyCreate(world_);
  dBodySetMass(chassis, &mass);
  dMatrix3 rotation;
  dRFromAxisAndAngle(rotation, 0, 0, 1, vehicle.start_yaw_rad);
  dBodySetRotation(chassis, rotation);
  dVector3 offset;
  dBodyVectorToWorld(chassis, axle_in_chassis_m_[0], axle_in_chassis_m_[1], axle_in_chassis_m_[2],
                     offset);
  dBodySetPosition(chassis, vehicle.start_x_m - offset[0], vehicle.start_y_m - offset[1],
                   vehicle.wheel_radius_m - offset[2]);
}

void OdeWorld::build_wheel(const VehicleConfig& vehicle, Body side) {
  constexpr int kAlongY = 2;
  dMass mass;
  dMassSetCylinderTotal(&mass, vehicle.wheel_mass_kg, kAlongY, vehicle.wheel_radius_m,
                        vehicle.wheel_width_m);
  const double lateral_m = (side == kLeft ? 0.5 : -0.5) * vehicle.track_m;
  const std::array<double, 3> centre{axle_in_chassis_m_[0], axle_in_chassis_m_[1] + lateral_m,
                                     axle_in_chassis_m_[2]};
  reach_m_ =
      std::max(reach_m_, norm(centre) + std::hypot(vehicle.wheel_radius_m, half_wheel_width_m_));

  dBodyID chassis = bodies_[kChassis];
  dVector3 position;
  dBodyGetRelPointPos(chassis, centre[0], centre[1], centre[2], position);
  dBodyID wheel = dBodyCreate(world_);
  dBodySetMass(wheel, &mass);
  dBodySetQuaternion(wheel, dBodyGetQuaternion(chassis));
  dBodySetPosition(wheel, position[0], position[1], position[2]);
  bodies_[side] = wheel;

  // Wheel first, chassis second, axis to the left: forward rolling counts positive.
  dVector3 axis;
  dBodyVectorToWorld(chassis, 0, 1, 0, axis);
  dJointID hinge = dJointCreateHinge(world_, nullptr);
  dJointAttach(hinge, wheel, chassis);
  dJointSetHingeAnchor(hinge, position[0], position[1], position[2]);
  dJointSetHingeAxis(hinge, axis[0], axis[1], axis[2]);
  dJointSetHingeParam(hinge, dParamFMax, vehicle.max_wheel_torque_Nm);
  dJointSetHingeParam(hinge, dParamVel, 0);
  dJointSetFeedback(hinge, &hinge_feedback_[side]);
  hinges_[side] = hinge;

  dJointID tyre_joint = dJointCreateBall(world_, nullptr);
  dJointSetFeedback(tyre_joint, &tyre_feedback_[side]);
  tyre_joints_[side] = tyre_joint;
}

}  // namespace tether
