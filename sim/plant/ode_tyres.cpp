#include <ode/ode.h>

#include <algorithm>

#include "common/vehicle/grip.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "sim/plant/ode_world.hpp"

namespace tether {

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
