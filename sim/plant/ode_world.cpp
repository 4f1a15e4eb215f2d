#include "sim/plant/ode_world.hpp"

#include <ode/ode.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "common/vehicle/grip.hpp"
#include "common/vehicle/vehicle_settings.hpp"

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

namespace {

// Time constant of the rubber's loss: at the 14 Hz of vehicle against tyres at rest, a loss factor
// of 0.4. Assumed; while the wheel rolls it changes next to nothing.
constexpr double kLoss_s = 5e-3;

double norm(const BrushTyre::Vector& v) { return std::hypot(v[0], v[1]); }

}  // namespace

double BrushTyre::steady_force(const Config& config, double slip, double pressing_N) {
  if (config.friction <= 0.0 || pressing_N <= 0.0) return 0.0;
  const double x = std::min(1.0, std::abs(slip) / sliding_slip(config));
  return config.friction * pressing_N * x * (3.0 - x * (3.0 - x));
}

BrushTyre::Row BrushTyre::prepare(const Vector& slip_mps, double rolling_mps, double pressing_N,
                                  double step_s) {
  step_s_ = step_s;
  const double release = 1.0 + std::abs(rolling_mps) * step_s / config_.relaxation_m;
  const double loss = kLoss_s / step_s;
  const Vector& u = deflection_m_;
  Vector stretch{};
  for (const int i : {0, 1}) {
    const double next_m = (u[i] + step_s * slip_mps[i]) / release;
    stretch[i] = next_m + loss * (next_m - u[i]);
  }
  // At no stretch the secant is the tangent; a tenth of a per mille of sliding is close enough.
  const double slip = std::max(norm(stretch) / config_.relaxation_m, 1e-4 * sliding_slip(config_));
  const double force = steady_force(config_, slip, pressing_N);
  stiffness_Npm_ = force > 0.0 ? force / (slip * config_.relaxation_m) : 0.0;
  Row row;
  if (stiffness_Npm_ == 0.0) return row;
  // F = −K (u' (1 + loss) − loss u) with u' = (u + h V')/release, solved for V'.
  const double give = release / (step_s * (1.0 + loss));
  row.softness_mps_N = give / stiffness_Npm_;
  for (const int i : {0, 1}) row.bias_mps[i] = u[i] * (loss * give - 1.0 / step_s);
  return row;
}

void BrushTyre::finish(const Vector& force_N) {
  if (stiffness_Npm_ == 0.0) {
    deflection_m_ = {};
    return;
  }
  const double loss = kLoss_s / step_s_;
  Vector& u = deflection_m_;
  for (const int i : {0, 1}) u[i] = (loss * u[i] - force_N[i] / stiffness_Npm_) / (1.0 + loss);
  // Bristles that slide are stretched no further.
  const double most_m = sliding_slip(config_) * config_.relaxation_m;
  const double size_m = norm(u);
  if (size_m > most_m) u = {u[0] * most_m / size_m, u[1] * most_m / size_m};
}

namespace {

// Constraint softness. The error reduction is ODE's usual 0.2 per step; the tiny constraint force
// mixing only keeps the redundant rows (both tyres hold the same axle sideways) solvable.
constexpr double kErp = 0.2;
constexpr double kCfm = 1e-9;
// Contacts rest up to this deep, so that they do not open and close at every step.
constexpr double kContactLayer_m = 0.5e-3;
constexpr double kMaxCorrectingSpeed_mps = 2.0;
// After a step that needed its limits the next ones probably need them, too, so they are solved
// with all limits at once.
constexpr int kLimitedStepsAfterLimit = 100;
// The chassis box clears the floor until it is tilted by about 19 degrees. Up to 5 degrees (this is
// their cosine) its corners need no test.
constexpr double kUprightCosine = 0.996;
// How much deeper one end of an upright chassis edge must be in a wall to carry all of the force.
constexpr double kFaceYield_m = 1e-3;
// A wheel whose axle is this close to vertical lies on its side and has no lowest rim point.
constexpr double kLyingWheel = 0.1;

}  // namespace

OdeWorld::OdeWorld(const VehicleConfig& vehicle, const WorldSettings& world, double step_s)
    : step_s_(step_s),
      wheel_radius_m_(vehicle.wheel_radius_m),
      half_wheel_width_m_(vehicle.wheel_width_m / 2.0),
      caster_radius_m_(vehicle.caster_radius_m),
      max_torque_Nm_(vehicle.max_wheel_torque_Nm),
      half_extent_m_(world.half_extent_m),
      floor_{{0, 0, 1}, 0, world.friction},
      slippery_floor_{{0, 0, 1}, 0, 0},
      walls_{{{{-1, 0, 0}, -world.half_extent_m, world.wall_friction},
              {{1, 0, 0}, -world.half_extent_m, world.wall_friction},
              {{0, -1, 0}, -world.half_extent_m, world.wall_friction},
              {{0, 1, 0}, -world.half_extent_m, world.wall_friction}}} {
  prepare_ode_thread();
  world_ = dWorldCreate();
  // ODE's default stepping "thread pool" is one global, unlocked object: worlds that are stepped by
  // different threads need one each.
  threading_ = dThreadingAllocateSelfThreadedImplementation();
  dWorldSetStepThreadingImplementation(world_, dThreadingImplementationGetFunctions(threading_),
                                       threading_);
  set_gravity(world);
  dWorldSetERP(world_, kErp);
  dWorldSetCFM(world_, kCfm);
  dWorldSetContactSurfaceLayer(world_, kContactLayer_m);
  dWorldSetContactMaxCorrectingVel(world_, kMaxCorrectingSpeed_mps);
  dWorldSetAutoDisableFlag(world_, 0);
  contacts_ = dJointGroupCreate(0);
  build_chassis(vehicle);
  build_wheel(vehicle, kLeft);
  build_wheel(vehicle, kRight);
  if (vehicle.tyre == VehicleConfig::Tyre::brush) make_brushes(vehicle, world);
}

OdeWorld::~OdeWorld() {
  obstacles_.reset();
  dJointGroupDestroy(contacts_);
  dWorldDestroy(world_);
  dThreadingFreeImplementation(threading_);
}

void OdeWorld::step(const WheelSpeeds& targets) {
  dJointSetHingeParam(hinges_[kLeft], dParamVel, targets.left_mps / wheel_radius_m_);
  dJointSetHingeParam(hinges_[kRight], dParamVel, targets.right_mps / wheel_radius_m_);
  dJointGroupEmpty(contacts_);
  add_wall_contacts();
  if (!near_.empty() && obstacles_->add_contacts(world_, contacts_, near_)) wall_contact_ = true;
  add_chassis_floor_contacts();
  find_tyre_points();
  if (!brushes_.empty()) return step_on_brushes();

  const bool rolls = tyres_[kLeft].touches && tyres_[kRight].touches;
  if (wall_contact_ || chassis_on_floor_) limited_steps_left_ = kLimitedStepsAfterLimit;
  if (rolls && limited_steps_left_ == 0 && !always_limited_) {
    set_limited(false);
    place_tyre_joints();
    save_bodies();
    solve();
    if (within_limits()) return;
    restore_bodies();
    limited_steps_left_ = kLimitedStepsAfterLimit;
    ++repeated_steps_;
  }
  set_limited(true);
  add_tyre_contacts();
  solve();
  ++limited_steps_;
  limited_steps_left_ = std::max(0, limited_steps_left_ - 1);
}

void OdeWorld::expect_obstacles(const VehicleConfig& vehicle, double fastest_mps) {
  obstacles_ = std::make_unique<OdeObstacles>(
      vehicle, bodies_[kChassis], box_in_chassis_m_,
      std::array<dBodyID, 2>{bodies_[kLeft], bodies_[kRight]}, walls_[0].friction);
  // A pushed body goes no slower than the pushing one.
  dWorldSetContactMaxCorrectingVel(world_, kMaxCorrectingSpeed_mps + fastest_mps);
}

WheelSpeeds OdeWorld::rim_speeds() const {
  return {dJointGetHingeAngleRate(hinges_[kLeft]) * wheel_radius_m_,
          dJointGetHingeAngleRate(hinges_[kRight]) * wheel_radius_m_};
}

double OdeWorld::motor_torque(Body side) const {
  const dReal* torque = hinge_feedback_[side].t1;
  const dReal* axle = tyres_[side].axle;
  return torque[0] * axle[0] + torque[1] * axle[1] + torque[2] * axle[2];
}

void OdeWorld::find_tyre_points() {
  // A tyre touches with the lowest point of its middle circle: one contact, so that no second one
  // at another distance from the axle's centre scrubs when the vehicle turns.
  for (const Body side : {kLeft, kRight}) {
    const dReal* r = dBodyGetRotation(bodies_[side]);
    const dReal* centre = dBodyGetPosition(bodies_[side]);
    const dReal axle[3] = {r[1], r[5], r[9]};
    const dReal horizontal = std::sqrt(axle[0] * axle[0] + axle[1] * axle[1]);
    TyrePoint& tyre = tyres_[side];
    std::copy_n(axle, 3, tyre.axle);
    tyre.touches = false;
    if (horizontal < kLyingWheel) continue;  // the chassis' corners carry it
    const dReal outward_m = wheel_radius_m_ * axle[2] / horizontal;
    tyre.position[0] = centre[0] + outward_m * axle[0];
    tyre.position[1] = centre[1] + outward_m * axle[1];
    tyre.position[2] = centre[2] - wheel_radius_m_ * horizontal;
    tyre.rolling[0] = axle[1] / horizontal;
    tyre.rolling[1] = -axle[0] / horizontal;
    tyre.touches = tyre.position[2] <= 0;
  }
}

void OdeWorld::add_chassis_floor_contacts() {
  dBodyID chassis = bodies_[kChassis];
  dVector3 point;
  dBodyGetRelPointPos(chassis, caster_in_chassis_m_[0], caster_in_chassis_m_[1],
                      caster_in_chassis_m_[2], point);
  point[2] -= caster_radius_m_;
  if (point[2] <= 0) add_contact(chassis, point, slippery_floor_, nullptr);

  chassis_on_floor_ = false;
  if (dBodyGetRotation(chassis)[10] > kUprightCosine) return;
  for (const auto& corner : corners_m_) {
    dBodyGetRelPointPos(chassis, corner[0], corner[1], corner[2], point);
    if (point[2] > 0) continue;
    add_contact(chassis, point, floor_, nullptr);
    chassis_on_floor_ = true;
  }
}

void OdeWorld::add_wall_contacts() {
  wall_contact_ = false;
  const dReal* centre = dBodyGetPosition(bodies_[kChassis]);
  const dReal near_m = half_extent_m_ - reach_m_;
  if (std::abs(centre[0]) < near_m && std::abs(centre[1]) < near_m) return;
  for (const Plane& wall : walls_) {
    if (wall.depth_m(centre) < -reach_m_) continue;
    collide_chassis(wall);
    collide_wheel(bodies_[kLeft], wall);
    collide_wheel(bodies_[kRight], wall);
  }
}

void OdeWorld::collide_chassis(const Plane& wall) {
  // One contact for each upright edge, where a slightly yielding face would put the centre of its
  // pressure: at half height if the edge lies flat, towards the deeper end if it is inclined. It
  // halves the solver's work against one contact a corner, and does not make a light chassis jump
  // when it hits a wall.
  dBodyID chassis = bodies_[kChassis];
  for (int edge = 0; edge < 4; ++edge) {
    const auto& bottom = corners_m_[edge];
    const auto& top = corners_m_[edge + 4];
    dVector3 low, high;
    dBodyGetRelPointPos(chassis, bottom[0], bottom[1], bottom[2], low);
    dBodyGetRelPointPos(chassis, top[0], top[1], top[2], high);
    const dReal low_m = wall.depth_m(low);
    const dReal high_m = wall.depth_m(high);
    if (std::max(low_m, high_m) < 0) continue;
    const dReal share = std::clamp(0.5 + 0.5 * (high_m - low_m) / kFaceYield_m, 0.0, 1.0);
    dReal point[3];
    for (int i = 0; i < 3; ++i) point[i] = low[i] + share * (high[i] - low[i]);
    add_contact(chassis, point, wall, nullptr);
    wall_contact_ = true;
  }
}

void OdeWorld::collide_wheel(dBodyID wheel, const Plane& wall) {
  // The foremost and rearmost points of both faces' rims: of an upright cylinder they are the ones
  // that reach a vertical wall first, and they do not jump while the wheel turns.
  const dReal* r = dBodyGetRotation(wheel);
  const dReal* centre = dBodyGetPosition(wheel);
  const dReal axle[3] = {r[1], r[5], r[9]};
  const dReal horizontal = std::sqrt(axle[0] * axle[0] + axle[1] * axle[1]);
  if (horizontal < kLyingWheel) return;
  const dReal forward[2] = {axle[1] / horizontal, -axle[0] / horizontal};
  for (const dReal x : {wheel_radius_m_, -wheel_radius_m_}) {
    for (const dReal y : {half_wheel_width_m_, -half_wheel_width_m_}) {
      const dReal point[3] = {centre[0] + x * forward[0] + y * axle[0],
                              centre[1] + x * forward[1] + y * axle[1], centre[2] + y * axle[2]};
      if (wall.depth_m(point) < 0) continue;
      add_contact(wheel, point, wall, nullptr);
      wall_contact_ = true;
    }
  }
}

void OdeWorld::add_contact(dBodyID body, const dReal* point, const Plane& plane,
                           const dReal* first_friction) {
  dContact contact{};
  contact.surface.mode = dContactApprox1 | (first_friction ? dContactFDir1 : 0);
  contact.surface.mu = plane.friction;
  std::copy_n(point, 3, contact.geom.pos);
  std::copy_n(plane.normal, 3, contact.geom.normal);
  contact.geom.depth = std::max(0.0, plane.depth_m(point));
  if (first_friction) std::copy_n(first_friction, 2, contact.fdir1);
  dJointAttach(dJointCreateContact(world_, contacts_, &contact), body, nullptr);
}

void OdeWorld::set_limited(bool limited) {
  if (limited == limited_) return;
  limited_ = limited;
  for (const Body side : {kLeft, kRight}) {
    dJointSetHingeParam(hinges_[side], dParamFMax, limited ? max_torque_Nm_ : dInfinity);
    dJointAttach(tyre_joints_[side], limited ? nullptr : bodies_[side], nullptr);
  }
}

void OdeWorld::place_tyre_joints() {
  for (const Body side : {kLeft, kRight}) {
    const dReal* p = tyres_[side].position;
    dJointSetBallAnchor(tyre_joints_[side], p[0], p[1], p[2]);
    // Like a contact, it pushes back only what is deeper than the layer.
    dJointSetBallAnchor2(tyre_joints_[side], p[0], p[1], std::max(p[2], -kContactLayer_m));
  }
}

void OdeWorld::add_tyre_contacts() {
  for (const Body side : {kLeft, kRight}) {
    const TyrePoint& tyre = tyres_[side];
    if (tyre.touches) add_contact(bodies_[side], tyre.position, floor_, tyre.rolling);
  }
}

bool OdeWorld::within_limits() const {
  for (const Body side : {kLeft, kRight}) {
    const dReal* force = tyre_feedback_[side].f1;
    const dReal* rolling = tyres_[side].rolling;
    const dReal limit_N = floor_.friction * force[2];  // negative if the floor would have to pull
    const dReal along_N = force[0] * rolling[0] + force[1] * rolling[1];
    const dReal across_N = force[1] * rolling[0] - force[0] * rolling[1];
    if (force[2] < 0 || std::abs(along_N) > limit_N || std::abs(across_N) > limit_N) return false;

    const dReal* r = dBodyGetRotation(bodies_[side]);
    const dReal* torque = hinge_feedback_[side].t1;
    const dReal servo_Nm = torque[0] * r[1] + torque[1] * r[5] + torque[2] * r[9];
    if (std::abs(servo_Nm) > max_torque_Nm_) return false;
  }
  return true;
}

void OdeWorld::save_bodies() {
  for (int i = 0; i < 3; ++i) {
    std::copy_n(dBodyGetPosition(bodies_[i]), 3, saved_[i].position);
    std::copy_n(dBodyGetQuaternion(bodies_[i]), 4, saved_[i].quaternion);
    std::copy_n(dBodyGetLinearVel(bodies_[i]), 3, saved_[i].velocity);
    std::copy_n(dBodyGetAngularVel(bodies_[i]), 3, saved_[i].spin);
  }
}

void OdeWorld::restore_bodies() {
  for (int i = 0; i < 3; ++i) {
    const BodyState& s = saved_[i];
    dBodySetPosition(bodies_[i], s.position[0], s.position[1], s.position[2]);
    dBodySetQuaternion(bodies_[i], s.quaternion);
    dBodySetLinearVel(bodies_[i], s.velocity[0], s.velocity[1], s.velocity[2]);
    dBodySetAngularVel(bodies_[i], s.spin[0], s.spin[1], s.spin[2]);
  }
}

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

void OdeWorld::set_gravity(const WorldSettings& world) {
  const auto [x, y, z] = gravity_on_slope_mps2(world);
  dWorldSetGravity(world_, x, y, z);
}

void OdeWorld::set_wheel_loads(const WheelLoads& loads) {
  loads_ = loads;
  loaded_ = true;
}

/// ODE forgets forces with each step, also with one that is taken back.
void OdeWorld::solve() {
  if (loaded_) {
    for (const Body side : {kLeft, kRight}) {
      const WheelLoad& load = loads_[side];
      const dReal* rolling = tyres_[side].rolling;
      dBodyAddForce(bodies_[side], load.forward_N * rolling[0], load.forward_N * rolling[1],
                    load.up_N);
      dJointAddHingeTorque(hinges_[side], load.torque_Nm);
    }
  }
  dWorldStep(world_, step_s_);
}

void OdeWorld::make_brushes(const VehicleConfig& vehicle, const WorldSettings& world) {
  const BrushTyre::Config config{.stiffness = vehicle.tyre_stiffness,
                                 .relaxation_m = vehicle.tyre_relaxation_m,
                                 .friction = world.friction};
  brushes_.assign(2, BrushTyre(config));
  const TyreLoads at_rest = tyre_loads(vehicle, world.gravity_mps2, {});
  for (const Body side : {kLeft, kRight}) pressing_N_[side] = at_rest.pressing_N[side];
}

void OdeWorld::step_on_brushes() {
  set_limited(true);
  for (const Body side : {kLeft, kRight}) {
    if (tyres_[side].touches) {
      add_brush_contact(side);
    } else {
      brushes_[side].lift();
    }
  }
  solve();
  ++limited_steps_;
  for (const Body side : {kLeft, kRight}) {
    if (!tyres_[side].touches) continue;
    const dReal* force = tyre_feedback_[side].f1;
    const dReal* rolling = tyres_[side].rolling;
    brushes_[side].finish({force[0] * rolling[0] + force[1] * rolling[1],
                           force[1] * rolling[0] - force[0] * rolling[1]});
    pressing_N_[side] = std::max(0.0, force[2]);
  }
}

void OdeWorld::add_brush_contact(Body side) {
  const TyrePoint& tyre = tyres_[side];
  const dReal* rolling = tyre.rolling;
  dVector3 velocity;
  dBodyGetPointVel(bodies_[side], tyre.position[0], tyre.position[1], tyre.position[2], velocity);
  const BrushTyre::Row row = brushes_[side].prepare(
      {velocity[0] * rolling[0] + velocity[1] * rolling[1],
       velocity[1] * rolling[0] - velocity[0] * rolling[1]},
      dJointGetHingeAngleRate(hinges_[side]) * wheel_radius_m_, pressing_N_[side], step_s_);
  dContact contact{};
  contact.surface.mode = dContactFDir1;
  if (row.softness_mps_N > 0.0) {
    contact.surface.mode |= dContactSlip1 | dContactSlip2 | dContactMotion1 | dContactMotion2;
    contact.surface.mu = dInfinity;  // the softness is the limit
    contact.surface.slip1 = contact.surface.slip2 = row.softness_mps_N;
    contact.surface.motion1 = row.bias_mps[0];
    contact.surface.motion2 = row.bias_mps[1];
  }
  std::copy_n(tyre.position, 3, contact.geom.pos);
  std::copy_n(floor_.normal, 3, contact.geom.normal);
  contact.geom.depth = std::max(0.0, floor_.depth_m(tyre.position));
  std::copy_n(rolling, 2, contact.fdir1);  // ODE's second direction is then the wheel's left
  const dJointID joint = dJointCreateContact(world_, contacts_, &contact);
  dJointAttach(joint, bodies_[side], nullptr);
  dJointSetFeedback(joint, &tyre_feedback_[side]);
}

}  // namespace tether
