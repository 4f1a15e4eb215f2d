#pragma once

#include <array>

namespace tether {

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

}  // namespace tether
