#pragma once

#include <ode/ode.h>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/vehicle/diff_drive.hpp"
#include "common/vehicle/pose.hpp"
#include "common/vehicle/vehicle_config.hpp"
#include "common/vehicle/vehicle_settings.hpp"
#include "common/world/shape.hpp"
#include "sim/plant/disturbances.hpp"

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

/// A tyre as an isotropic brush that slips (vehicle.tyre = "brush"). Pure: one contact, one step.
///
/// **Slip curve.** The tread is a row of elastic bristles on a rigid carcass. With the theoretical
/// slip σ = V_s/|V_r| (V_s: velocity of the contact point over the floor, V_r: rolling speed Ω r),
/// normal force N, stiffness per load k = (dF/dσ at 0)/N, and friction μ, the force is against V_s
/// and has the size
///
///   F(σ) = μ N (3 θσ − 3 (θσ)² + (θσ)³)  for θσ < 1,   μ N beyond,   θ = k/(3 μ),
///
/// equal in all directions: longitudinal and lateral slip share one limit, a circle. Source:
/// H. B. Pacejka, Tire and Vehicle Dynamics, chapter 3, the brush model for combined slip with
/// equal stiffnesses (quoted from memory; its equation's number was not looked up). No
/// self-aligning moment: the contact is a point.
///
/// **Relaxation.** At standstill σ has no meaning, and at low speed 1/|V_r| has no bound. So the
/// deflection u of the contact is a state: it is dragged along by slip and released by rolling,
///
///   du/dt = V_s − (|V_r|/ℓ) u,     F = −F(|u|/ℓ) u/|u|,   |u| ≤ ℓ/θ
///
/// (ibid., chapter 7, the transient "single contact point" model). Steadily rolling, u/ℓ = σ; at
/// rest, the tyre is a spring of k N/ℓ, which holds without creeping. A loss of rubber, τ du/dt
/// added to u, damps what this spring and the vehicle's mass would do.
///
/// **Step.** Backward Euler. Its only unknown is the velocity after the step: u' =
/// (u + h V')/(1 + |V_r|h/ℓ). The secant stiffness is K = F(|w|/ℓ)/|w| at the stretch w expected
/// from the velocity before the step. With it the force is linear in V', so the solver of the
/// bodies gets a row "V' = bias − softness · F" (a constraint with softness), and the step is
/// stable however stiff the tyre or light the wheel.
class BrushTyre {
 public:
  struct Config {
    double stiffness = 20.0;
    double relaxation_m = 0.02;
    double friction = 0.6;
  };
  using Vector = std::array<double, 2>;  ///< along the wheel's heading, and to the left of it

  /// V' = bias − softness · F, in both directions.
  struct Row {
    double softness_mps_N = 0.0;  ///< 0: no grip, leave the row out
    Vector bias_mps{};
  };

  explicit BrushTyre(const Config& config) : config_(config) {}

  /// Input of the solver for a step. `slip_mps` is the contact point's velocity before it,
  /// `rolling_mps` the rim speed, `pressing_N` the normal force.
  Row prepare(const Vector& slip_mps, double rolling_mps, double pressing_N, double step_s);
  /// The force on the tyre that came out.
  void finish(const Vector& force_N);
  /// The tyre is in the air.
  void lift() { *this = BrushTyre(config_); }

  /// Size of the force in steady slip, F(σ), in newtons.
  static double steady_force(const Config& config, double slip, double pressing_N);
  /// The slip from which on all bristles slide, 1/θ.
  static double sliding_slip(const Config& config) {
    return 3.0 * config.friction / config.stiffness;
  }

  const Vector& deflection_m() const { return deflection_m_; }

 private:
  Config config_;
  Vector deflection_m_{};
  double stiffness_Npm_ = 0.0;  ///< the step's secant stiffness
  double step_s_ = 0.0;
};

/// Readies ODE for the calling thread and routes its global message handlers. Cheap to repeat.
/// ODE's warnings are counted, never printed; its fatal errors abort with their text.
void prepare_ode_thread();

/// Warnings that ODE has raised in the calling thread so far.
std::uint64_t ode_complaints_of_this_thread();

/// The bare rigid-body world: chassis (with the caster merged into it), two wheels on hinges with
/// speed servos, a floor and four walls. It knows nothing of commands, limits or poses: `step`
/// hands both servos a target and lets ODE work. OdeVehicle is the plant built on it; a benchmark
/// of "ODE alone" replays recorded servo targets through this class.
///
/// There is no collision space, and for floor and walls no ODE geom: three bodies against five
/// planes need neither. Contact points are computed here, exactly for a vehicle that stands upright
/// (docs/explanation/physics.md). Obstacles are OdeObstacles' business.
///
/// Most steps neither slip nor saturate a servo. Each step is therefore first solved as if that
/// were so (tyres as ball joints at their contact points, servos unlimited), which leaves the
/// solver one inequality instead of nine; if the forces that come out break a limit, the bodies are
/// put back and the step is solved with all limits. Both ways satisfy the same equations whenever
/// the limits hold.
///
/// With vehicle.tyre = "brush" tyres slip as BrushTyre says: each step has rows for their slip in
/// place of friction, and the limits of the servos. Their normal force is that of the step before.
class OdeWorld {
 public:
  enum Body { kLeft = 0, kRight = 1, kChassis = 2 };

  OdeWorld(const VehicleConfig& vehicle, const WorldSettings& world, double step_s);
  ~OdeWorld();
  OdeWorld(const OdeWorld&) = delete;
  OdeWorld& operator=(const OdeWorld&) = delete;

  /// One step; `targets` are the rim speeds that the servos drive towards, torque permitting.
  void step(const WheelSpeeds& targets);

  /// Once, before any obstacle may be near; none is ever faster.
  void expect_obstacles(const VehicleConfig& vehicle, double fastest_mps);
  /// The obstacles that may be touched in the next step, where they are. They are looked at then.
  void set_near(std::span<const Shape> near) { near_ = near; }

  /// Sets the loads on the wheels in each step from now on, beside servos and floor.
  void set_wheel_loads(const WheelLoads& loads);

  /// Rim speeds relative to the chassis, forward positive: what an encoder sees.
  WheelSpeeds rim_speeds() const;

  /// Torque of the motor of a wheel, kLeft or kRight, in the last step, forward positive.
  double motor_torque(Body side) const;

  dBodyID chassis() const { return bodies_[kChassis]; }
  /// The axle's midpoint in the chassis body's frame, whose origin is its centre of mass.
  const std::array<double, 3>& axle_in_chassis_m() const { return axle_in_chassis_m_; }
  /// With brush tyres, the normal forces [N] on the left and the right one in the last step.
  std::array<double, 2> pressing() const { return pressing_N_; }
  /// Whether anything touched a wall or an obstacle in the last step.
  bool wall_contact() const { return wall_contact_; }
  /// Steps so far that were solved with all limits, and how many of them only at the second try.
  std::uint64_t limited_steps() const { return limited_steps_; }
  std::uint64_t repeated_steps() const { return repeated_steps_; }

  /// Solves every step with all limits at once: the reference for tests. Slower, same motion.
  void set_always_limited(bool always) { always_limited_ = always; }

 private:
  struct Plane {
    dReal normal[3];  ///< points to the inside
    dReal offset_m;   ///< inside is normal · p ≥ offset
    dReal friction;

    /// How far `point` lies outside; negative: inside.
    dReal depth_m(const dReal* point) const {
      return offset_m - (normal[0] * point[0] + normal[1] * point[1] + normal[2] * point[2]);
    }
  };
  /// Where a tyre is lowest, and how it is oriented there.
  struct TyrePoint {
    dReal position[3];
    dReal rolling[2];  ///< horizontal unit vector, forward
    dReal axle[3];     ///< unit vector to the left, when the step began: about it the motor turns
    bool touches;
  };
  struct BodyState {
    dReal position[3], quaternion[4], velocity[3], spin[3];
  };

  void build_chassis(const VehicleConfig& vehicle);
  void build_wheel(const VehicleConfig& vehicle, Body side);

  void find_tyre_points();
  void add_chassis_floor_contacts();
  void add_wall_contacts();
  void collide_chassis(const Plane& wall);
  void collide_wheel(dBodyID wheel, const Plane& wall);
  void add_contact(dBodyID body, const dReal* point, const Plane& plane,
                   const dReal* first_friction);

  void set_gravity(const WorldSettings& world);
  void solve();
  void set_limited(bool limited);
  void place_tyre_joints();
  void add_tyre_contacts();
  bool within_limits() const;
  // With brush tyres, in ode_tyres.cpp.
  void make_brushes(const VehicleConfig& vehicle, const WorldSettings& world);
  void step_on_brushes();
  void add_brush_contact(Body side);
  void save_bodies();
  void restore_bodies();

  dWorldID world_ = nullptr;
  dThreadingImplementationID threading_ = nullptr;
  dJointGroupID contacts_ = nullptr;  ///< emptied and filled again at every step
  dBodyID bodies_[3] = {};
  dJointID hinges_[2] = {};
  dJointID tyre_joints_[2] = {};           ///< balls at the tyre points; detached in limited steps
  dJointFeedback hinge_feedback_[2] = {};  ///< all 0 before the first step
  dJointFeedback tyre_feedback_[2] = {};

  double step_s_;
  double wheel_radius_m_;
  double half_wheel_width_m_;
  double caster_radius_m_;
  double max_torque_Nm_;
  double half_extent_m_;
  double reach_m_ = 0.0;  ///< no part of the vehicle is farther from the chassis body's origin
  Plane floor_;
  Plane slippery_floor_;  ///< surface parameters for the caster
  std::array<Plane, 4> walls_;
  std::array<double, 3> axle_in_chassis_m_{};
  std::array<double, 3> caster_in_chassis_m_{};
  /// Corners of the box; i and i + 4: one upright edge.
  std::array<std::array<double, 3>, 8> corners_m_{};

  std::array<double, 3> box_in_chassis_m_{};

  std::unique_ptr<OdeObstacles> obstacles_;  ///< if any are expected
  std::span<const Shape> near_;
  TyrePoint tyres_[2] = {};
  std::vector<BrushTyre> brushes_;      ///< left and right; empty: tyres are rigid
  std::array<double, 2> pressing_N_{};  ///< on brushes, in the last step in which they touched
  WheelLoads loads_;
  bool loaded_ = false;
  BodyState saved_[3];
  bool wall_contact_ = false;
  bool chassis_on_floor_ = false;
  bool limited_ = true;
  bool always_limited_ = false;
  int limited_steps_left_ = 0;
  std::uint64_t limited_steps_ = 0;
  std::uint64_t repeated_steps_ = 0;
};

}  // namespace tether
