// The part of OdeWorld that puts loads on its bodies.
#include "sim/plant/ode_world.hpp"

namespace tether {

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

}  // namespace tether
