#include "sim/plant/ode_world.hpp"

#include <algorithm>
#include <cmath>

#include "common/vehicle/vehicle_settings.hpp"

namespace tether {
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

}  // namespace tether
